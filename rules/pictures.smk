"""Pictures, the movie, and what slides and papers want of them."""


rule render:
    input:
        scene=SCENE,
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=FRAMES,
        surfaces="outputs/{scene}/{level}/surfaces/segment_{segment}",
    output:
        directory(IMAGES),
    log:
        "outputs/{scene}/{level}/logs/render_{segment}.log",
    resources:
        mem_mb=flow.memory("render"),
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
        scene=SCENE,
        images=all_segments(IMAGES),
    output:
        movie=report(
            "outputs/{scene}/{level}/movie.mp4",
            **SHELF,
            caption="../docs/report/movie.rst",
            labels={"what": "1 movie"},
        ),
        animation="outputs/{scene}/{level}/movie.gif",
        poster="outputs/{scene}/{level}/poster.png",
        moments=report(
            "outputs/{scene}/{level}/moments.png",
            **SHELF,
            caption="../docs/report/picture.rst",
            labels={"what": "5 pictures: eight moments"},
        ),
    log:
        "outputs/{scene}/{level}/logs/movie.log",
    params:
        depends=flow.depends("movie"),
    message:
        "{wildcards.scene} at {wildcards.level}: make the movie"
    shell:
        "python -m pipeline.movie {input.images} --scene {input.scene} --output {output.movie}"
        " --animation {output.animation} --poster {output.poster} --moments {output.moments} 2>&1 | tee {log}"


rule still:
    input:
        scene=SCENE,
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=lambda w: expand(FRAMES, segment=flow.segments(w.scene, w.level)[-1], allow_missing=True),
        surfaces=lambda w: expand(
            "outputs/{scene}/{level}/surfaces/segment_{segment}",
            segment=flow.segments(w.scene, w.level)[-1],
            allow_missing=True,
        ),
    output:
        report(
            "outputs/{scene}/{level}/still.png",
            **SHELF,
            caption="../docs/report/still.rst",
            labels={"what": "2 illustration of the last frame"},
        ),
    log:
        "outputs/{scene}/{level}/logs/still.log",
    threads: lambda w: cores()
    resources:
        mem_mb=2000,  # Mitsuba takes 1.3 GB for 1280 x 720 pixels
    params:
        depends=flow.depends("still"),
    message:
        "{wildcards.scene} at {wildcards.level}: draw the still of the last frame"
    shell:
        "python -m pipeline.still {input.scene} {input.eye} {input.frames} {input.surfaces} --output {output}"
        " --threads {threads} 2>&1 | tee {log}"


# On request: it takes 7 minutes of two cores for 201 pictures, where the simulation at draft takes 3.
rule illustrate:
    input:
        scene=SCENE,
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=FRAMES,
        surfaces="outputs/{scene}/{level}/surfaces/segment_{segment}",
        last=lambda w: expand(FRAMES, segment=flow.segments(w.scene, w.level)[-1], allow_missing=True),
    output:
        directory("outputs/{scene}/{level}/illustrations/segment_{segment}"),
    log:
        "outputs/{scene}/{level}/logs/illustrate_{segment}.log",
    threads: lambda w: cores()
    resources:
        mem_mb=2000,  # Mitsuba takes 1.3 GB for 1280 x 720 pixels
    params:
        depends=flow.depends("illustrate"),
    message:
        "{wildcards.scene} at {wildcards.level}: illustrate segment {wildcards.segment}"
    shell:
        "python -m pipeline.illustrate {input.scene} {input.eye} {input.frames} {input.surfaces} --last {input.last}"
        " --output {output} --threads {threads} --depends {params.depends:q} 2>&1 | tee {log}"


rule film:
    input:
        scene=SCENE,
        images=all_segments("outputs/{scene}/{level}/illustrations/segment_{segment}"),
    output:
        film="outputs/{scene}/{level}/film.mp4",
        animation="outputs/{scene}/{level}/film.gif",
    log:
        "outputs/{scene}/{level}/logs/film.log",
    params:
        depends=flow.depends("movie"),
    message:
        "{wildcards.scene} at {wildcards.level}: make a film of the illustrations"
    shell:
        "python -m pipeline.movie {input.images} --scene {input.scene} --output {output.film}"
        " --animation {output.animation} 2>&1 | tee {log}"


# On request too; by PyVista, which takes 2 s for a picture where Mitsuba takes 15 of a view that changes.
rule turntable:
    input:
        scene=SCENE,
        eye="outputs/{scene}/{level}/eye.vtp",
        frames=lambda w: expand(FRAMES, segment=flow.segments(w.scene, w.level)[-1], allow_missing=True),
        surfaces=lambda w: expand(
            "outputs/{scene}/{level}/surfaces/segment_{segment}",
            segment=flow.segments(w.scene, w.level)[-1],
            allow_missing=True,
        ),
    output:
        "outputs/{scene}/{level}/turntable.mp4",
    log:
        "outputs/{scene}/{level}/logs/turntable.log",
    params:
        depends=flow.depends("turntable"),
    message:
        "{wildcards.scene} at {wildcards.level}: turn the eye of the last frame"
    shell:
        "python -m pipeline.turntable {input.scene} {input.eye} {input.frames} {input.surfaces} --renderer pyvista"
        " --output {output} 2>&1 | tee {log}"
