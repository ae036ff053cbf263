"""What the shell does before the command of every rule."""

# Snakemake tells OpenMP and the like how many threads a job has; this tells VTK and the drawing without a GPU.
THREADS = "export VTK_SMP_MAX_THREADS=$OMP_NUM_THREADS LP_NUM_THREADS=$OMP_NUM_THREADS"
# The word of a stage that cannot speak for itself any more goes into its log, as its own words do.
# Parentheses, since Snakemake takes braces as its own.
ENDED = 'python() ( command python "$@" || command python -m pipeline.base.ended $? "$@" )'
PREFIX = f"set -euo pipefail; {THREADS}; {ENDED}; "
