"""All numbers of docs/results: `snakemake -j2 results` runs what they come from, the cheapest first, and takes them.

It goes on where it was stopped, over days. `results_small` leaves out what takes more than two hours. `snakemake -n
results` tells what there is to run and how long each takes. Only a clone has docs/results.
"""

for run in results.runs:

    rule:
        name:
            f"results_of_{run.key}"
        input:
            results.inputs(run),
        output:
            str(run.stamp),
        params:
            about=run.words(),
            commands=results.commands(run),
        message:
            "{params.about}"
        shell:
            "({params.commands}) > {output}.log 2>&1 && mv {output}.log {output} || {{ cat {output}.log >&2; exit 1; }}"


rule results:
    input:
        [str(run.stamp) for run in results.runs],
    message:
        "all numbers of docs/results are of this code"


rule results_small:
    input:
        [str(run.stamp) for run in results.runs if not run.long],
    message:
        "the numbers of docs/results are of this code, but those of the runs of more than two hours"


results.hasten(workflow.rules)
