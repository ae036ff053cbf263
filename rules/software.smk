"""What is installed: name, version and license of every package."""

from pipeline.base.packages import packages_digest
from pipeline.workflow.digest import stage_digest


rule software:
    output:
        page=report(
            "outputs/software.html",
            category="software",
            caption="../docs/report/software.rst",
            labels={"what": "packages, versions, licenses"},
        ),
        table="outputs/software.csv",
    log:
        "outputs/logs/software.log",
    params:
        depends=lambda w: [packages_digest(), stage_digest("software")],
    message:
        "list the packages that are installed"
    shell:
        "python -m pipeline.software --output {output.page} --output {output.table} 2>&1 | tee {log}"
