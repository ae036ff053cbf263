"""What tests look for in what Snakemake prints."""
import re
from collections import Counter

TRACE = "Traceback"


def planned(output):
    """Return how often every rule is planned, from the table that a dry run ends with."""
    return Counter({name: int(count) for name, count in re.findall(r"^(\w+) +(\d+)$", output, re.MULTILINE)})
