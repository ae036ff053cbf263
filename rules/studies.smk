"""Studies: `snakemake -j2 <study>` runs the cases of config/studies/<study>.yaml, one job each, and gathers them.

The level is that of `--config accuracy=...`, or of the path: `snakemake -j2 outputs/studies/<study>/<level>/table.html`.
"""

# Where all results are asked for, cases have rules of their own, by which those of cheap studies come first.
for name, study, level, priority in [*results.rules("study"), ("study_case", "[A-Za-z0-9_]+", flow.any_level, 0)]:
    if name != "study_case":
        workflow.ruleorder(name, "study_case")

    rule:
        name:
            name
        input:
            lambda w: studies.inputs(w.study, w.level, w.case),
        output:
            directory("outputs/studies/{study}/{level}/cases/{case}"),
        log:
            "outputs/studies/{study}/{level}/logs/{case}.log",
        wildcard_constraints:
            study=study,
            level=level,
            case=r"[A-Za-z0-9_.-]+",
        priority: priority
        threads: lambda w: studies.threads(w.study, w.level, w.case, cores())
        resources:
            mem_mb=studies.memory,
            gpu=flow.gpus("auto"),
        params:
            depends=lambda w: studies.depends(w.study, w.level, w.case),
        message:
            "{wildcards.study} at {wildcards.level}: run {wildcards.case}"
        shell:
            "python -m pipeline.study {wildcards.study} --case {wildcards.case} --accuracy {wildcards.level}"
            " --threads {threads} {flow.device} --output {output} 2>&1 | tee {log}"


for name in studies.names:
    folder = f"outputs/studies/{name}/{{level}}"
    shelf = {"category": "studies", "subcategory": f"{name} at {{level}}"}

    rule:
        name:
            f"{name}_report"
        input:
            lambda w, study=name: studies.case_folders(study, w.level),
        output:
            table=report(
                f"{folder}/table.csv", **shelf, caption="../docs/report/study.rst", labels={"what": "3 table (CSV)"}
            ),
            page=report(
                f"{folder}/table.html",
                **shelf,
                caption="../docs/report/study.rst",
                labels={"what": "1 what was found"},
            ),
            pictures=[
                report(
                    f"{folder}/{picture}.png",
                    **shelf,
                    caption="../docs/report/study_figure.rst",
                    labels={"what": f"2 {picture.replace('_', ' ')}"},
                )
                for picture in studies.pictures(name)
            ],
            tables=[
                report(
                    f"{folder}/{table}.csv",
                    **shelf,
                    caption="../docs/report/study.rst",
                    labels={"what": f"4 {table.replace('_', ' ')} (CSV)"},
                )
                for table in studies.tables(name)
            ],
        log:
            f"{folder}/logs/report.log",
        params:
            depends=lambda w, study=name: studies.report_depends(study, w.level),
            study=name,
        message:
            "{params.study} at {wildcards.level}: gather the cases"
        shell:
            "python -m pipeline.study_report {params.study} --accuracy {wildcards.level}"
            " --folder $(dirname {output.table}) 2>&1 | tee {log}"

    rule:
        name:
            name
        input:
            f"outputs/studies/{name}/{flow.accuracy}/table.html",
        message:
            "done: {input}"
