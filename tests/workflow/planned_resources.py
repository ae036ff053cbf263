"""What the jobs of a plan ask for: `python planned_resources.py TARGET MAX_THREADS [KEY=VALUE...]`, as JSON.

A dry run does not print it where a rule has a message of its own, and takes one core as the total, where a cluster has
none: whoever asks for a total then ends the plan.
"""
import json
import sys
from pathlib import Path

from snakemake.api import SnakemakeApi
from snakemake.settings.types import ConfigSettings, DAGSettings, OutputSettings, Quietness, ResourceSettings

ASKED = ("_cores", "mem_mb", "gpu")

target, threads, *values = sys.argv[1:]
with SnakemakeApi(OutputSettings(quiet={Quietness.ALL})) as api:
    workflow = api.workflow(
        # Without cores, as with the profiles of clusters: only their jobs have some.
        ResourceSettings(nodes=100, max_threads=int(threads)), snakefile=Path("Snakefile"),
        config_settings=ConfigSettings(config=dict(value.split("=") for value in values),
                                       configfiles=[Path("config/config.yaml")]))
    workflow.dag(DAGSettings(targets={target})).execute_workflow(executor="dryrun")
    jobs = workflow._workflow.dag.jobs
    print("PLAN", json.dumps({job.rule.name: {name: job.resources.get(name) for name in ASKED} for job in jobs}))
