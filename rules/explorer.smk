"""The explorer: one page for all fills and postures, from tables of shapes at rest."""

from pipeline.scenes.load import PROJECT_CONFIG


rule explorer:
    input:
        tables=sorted(map(str, (PROJECT_CONFIG / "oil_at_rest" / "explorer").glob("*"))),
    output:
        report(
            "outputs/explorer.html",
            category="explorer",
            caption="../docs/report/explorer.rst",
            labels={"what": "what oil touches, by fill and posture"},
        ),
    log:
        "outputs/logs/explorer.log",
    params:
        depends=stage_digest("explorer_page"),
        texts=room_texts("explorer", "web"),
    message:
        "make the explorer"
    shell:
        "python -m pipeline.explorer_page --output {output} 2>&1 | tee {log}"
