"""Studies: `snakemake -j2 <study>` runs the cases of config/studies/<study>.yaml, one job each, and gathers them."""
from pipeline.study_workflow import Studies

studies = Studies(flow)


rule study_case:
    input:
        lambda w: studies.inputs(w.study, w.case),
    output:
        directory("outputs/studies/{study}/cases/{case}"),
    params:
        depends=lambda w: studies.depends(w.study, w.case),
    wildcard_constraints:
        study=r"[A-Za-z0-9_]+",
        case=r"[A-Za-z0-9_.-]+",
    log: "outputs/studies/{study}/logs/{case}.log",
    message: "{wildcards.study}: run {wildcards.case}",
    threads: lambda w: studies.threads(w.study, w.case, workflow.cores)
    shell:
        "python -m pipeline.study {wildcards.study} --case {wildcards.case} --accuracy {flow.accuracy}"
        " --threads {threads} --output {output} 2>&1 | tee {log}"


for name in studies.names:
    rule:
        name: name
        input:
            lambda w, study=name: studies.case_folders(study),
        output:
            table=report(f"outputs/studies/{name}/table.csv", category="studies", subcategory=name,
                         caption="../docs/report/study.rst", labels={"what": "3 table (CSV)"}),
            page=report(f"outputs/studies/{name}/table.html", category="studies", subcategory=name,
                        caption="../docs/report/study.rst", labels={"what": "1 what was found"}),
            pictures=[report(f"outputs/studies/{name}/{picture}.png", category="studies", subcategory=name,
                             caption="../docs/report/study_figure.rst",
                             labels={"what": f"2 {picture.replace('_', ' ')}"})
                      for picture in studies.pictures(name)],
            tables=[report(f"outputs/studies/{name}/{table}.csv", category="studies", subcategory=name,
                           caption="../docs/report/study.rst", labels={"what": f"4 {table.replace('_', ' ')} (CSV)"})
                    for table in studies.tables(name)],
        params:
            depends=lambda w, study=name: studies.report_depends(study),
            study=name,
        log: f"outputs/studies/{name}/logs/report.log",
        message: "{params.study}: gather the cases"
        shell:
            "python -m pipeline.study_report {params.study} {input} --accuracy {flow.accuracy}"
            " --output outputs/studies/{params.study} 2>&1 | tee {log}"
