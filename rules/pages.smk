"""One page of every run, and what tells elsewhere whether the run is as it was made."""


rule page:
    input:
        scene=SCENE,
        source=ancient(local(flow.scene_file)),
        initial="outputs/{scene}/{level}/initial.npz",
        eye="outputs/{scene}/{level}/eye.vtp",
        surfaces=all_segments("outputs/{scene}/{level}/surfaces/segment_{segment}"),
        images=all_segments(IMAGES),
        movie="outputs/{scene}/{level}/movie.mp4",
        still=lambda w: flow.still(w.scene, w.level),
        metrics="outputs/{scene}/{level}/metrics.csv",
        meanings="outputs/{scene}/{level}/metrics.json",
        index="outputs/{scene}/{level}/run.pvd",
        costs=all_segments("outputs/{scene}/{level}/costs/segment_{segment}.json"),
        linked=expand("outputs/{{scene}}/{{level}}/{page}.html", page=["advice", "cost", "effects"]),
    output:
        report(
            "outputs/{scene}/{level}/index.html",
            **SHELF,
            caption="../docs/report/page.rst",
            labels={"what": "0 all on one page"},
        ),
    log:
        "outputs/{scene}/{level}/logs/page.log",
    resources:
        mem_mb=flow.memory("page"),
    params:
        depends=flow.depends("page"),
        texts=flow.page_texts,
        errors=flow.expected_errors(),
    message:
        "{wildcards.scene} at {wildcards.level}: make the page"
    shell:
        "python -m pipeline.page $(dirname {output}) --source {input.source}" " --output {output} 2>&1 | tee {log}"


# The last of a run. What it lists is in its input, or in `requested`: what was made because somebody asked for it.
rule crate:
    input:
        scene=SCENE,
        page="outputs/{scene}/{level}/index.html",
        cavity=multiext("outputs/{scene}/{level}/", "eye.vtp", "eye.json", "initial.npz", "voxelize.json"),
        frames=all_segments(FRAMES),
        checkpoints=all_segments("outputs/{scene}/{level}/checkpoints/segment_{segment}.npz"),
        costs=all_segments("outputs/{scene}/{level}/costs/segment_{segment}.json"),
        surfaces=all_segments("outputs/{scene}/{level}/surfaces/segment_{segment}"),
        images=all_segments(IMAGES),
        pictures=multiext("outputs/{scene}/{level}/", "movie.mp4", "movie.gif", "poster.png", "moments.png"),
        still=lambda w: flow.still(w.scene, w.level),
        measures=multiext("outputs/{scene}/{level}/", "metrics.csv", "metrics.html", "metrics.json", "plots"),
        index=multiext("outputs/{scene}/{level}/", "run.pvd", "run", "view_run.py"),
        pages=multiext("outputs/{scene}/{level}/", "advice.html", "cost.html", "effects.html", "effects.csv"),
    output:
        crate="outputs/{scene}/{level}/ro-crate-metadata.json",
        workflow=directory("outputs/{scene}/{level}/workflow"),
    log:
        "outputs/{scene}/{level}/logs/crate.log",
    threads: lambda w: min(4, cores())
    params:
        depends=flow.crate_depends,
        requested=flow.requested,
    message:
        "{wildcards.scene} at {wildcards.level}: write the crate of the run"
    shell:
        "python -m pipeline.crate $(dirname {output.crate}) --threads {threads} 2>&1 | tee {log}"
