"""Pictures and the movie."""


rule render:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=FRAMES,
        surfaces="outputs/{scene}/{level}/surfaces/segment_{segment}",
    output:
        report(
            directory(IMAGES),
            patterns=["frame_{frame}.png"],
            **SHELF,
            caption="../docs/report/picture.rst",
            labels={"what": "5 picture of frame {frame}"},
        ),
    log:
        "outputs/{scene}/{level}/logs/render_{segment}.log",
    params:
        depends=flow.depends("render"),
    message:
        "{wildcards.scene} at {wildcards.level}: draw segment {wildcards.segment}"
    shell:
        "STAGE_USAGE={log}.json "
        "python -m pipeline.render {input.scene} {input.initial} {input.eye} {input.frames} {input.surfaces}"
        " --output {output} 2>&1 | tee {log}"


rule movie:
    input:
        all_segments(IMAGES),
    output:
        report(
            "outputs/{scene}/{level}/movie.mp4",
            **SHELF,
            caption="../docs/report/movie.rst",
            labels={"what": "1 movie"},
        ),
    log:
        "outputs/{scene}/{level}/logs/movie.log",
    params:
        depends=stage_digest("movie"),
    message:
        "{wildcards.scene} at {wildcards.level}: make the movie"
    shell:
        "python -m pipeline.movie {input} --output {output} --fps 24 2>&1 | tee {log}"
