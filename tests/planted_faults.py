"""Plant faults one by one into copies of the project, and see which test finds each: how much the tests can see.

    python tests/planted_faults.py                    every fault, in some minutes; writes docs/planted_faults.md
    python tests/planted_faults.py --only NAME ...    some of them, without the page
    python tests/planted_faults.py --sound            only see that the tests pass without any fault
    python tests/planted_faults.py --list             what is planted, and which test should find it

The faults are in ``fault_table.py``. CI does not run this.
"""
import argparse
import csv
import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from fault_table import FAULTS, Fault

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "planted_faults.md"
PACKAGES = ("sim", "pipeline", "studies")
TIMEOUT = 300.0  # s, for the test of one fault
# A fault that does not compile, or names what is not there, shows nothing.
BROKEN = ("collection failure", "SyntaxError", "CompilationError", "NameError", "ImportError", "ModuleNotFoundError",
          "IndentationError", "UnboundLocalError", "TaichiTypeError")
NOT_FOUND = "NOT FOUND"
INTRODUCTION = (
    "# Planted faults", "",
    "How much do the tests see? `python tests/planted_faults.py` plants these faults one by one into copies of the",
    "project and runs one test for each, which has to fail; then it writes this page. With `--sound` it runs the same",
    "tests without any fault.", "")


@dataclasses.dataclass(frozen=True)
class Finding:
    """What the test of a fault has said.

    Attributes
    ----------
    where : file with the fault, relative to the project. found_by : test that failed, or why none did.
    reason : first line of its failure. seconds : that it took, with the start of pytest.
    """

    fault: Fault
    where: str
    found_by: str
    reason: str
    seconds: float

    @property
    def found(self) -> bool:
        """Whether a test has failed for the fault."""
        return self.found_by.startswith("test_")


def copied(folder: Path) -> Path:
    """Copy the files that git tracks into a folder and return it."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, names.split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    return folder


def place_of(fault: Fault, project: Path) -> Path:
    """Return the file with the snippet of a fault.

    Raises
    ------
    LookupError
        There is not exactly one such place.
    """
    counts = {path: path.read_text(encoding="utf-8").count(fault.snippet)
              for package in PACKAGES for path in sorted((project / package).rglob("*.py"))}
    found = sum(counts.values())
    if found != 1:
        raise LookupError(f"{fault.name}: its snippet stands {found} times below {' and '.join(PACKAGES)}, but must "
                          f"stand there once: {fault.snippet}")
    return max(counts, key=counts.get)


def test_of(fault: Fault, project: Path) -> str:
    """Return what pytest calls the finder of a fault.

    Raises
    ------
    LookupError
        There is not exactly one such test.
    """
    stem, _, test = fault.finder.rpartition("::")
    function = test.partition("[")[0]
    found = [path for path in sorted((project / "tests").rglob("test_*.py"))
             if f"def {function}(" in path.read_text(encoding="utf-8") and stem in ("", path.stem)]
    if len(found) != 1:
        raise LookupError(f"{fault.name}: {len(found)} files have a test {fault.finder}, but one must")
    return f"{found[0].relative_to(project)}::{test}"


def run_tests(project: Path, tests: list[str], timeout: float) -> tuple[list[tuple[str, str]], int | None]:
    """Run tests of a copy of the project.

    Returns
    -------
    name and first line of the message of every test that failed, and the exit code, None after `timeout` s.
    """
    report = project / "report.xml"
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", f"--junitxml={report}"]
    process = subprocess.Popen([*command, *tests], cwd=project, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT,
                               env=os.environ | {"PYTHONPATH": str(project)}, start_new_session=True)
    try:
        code = process.wait(timeout)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)  # with what the tests have started
        process.wait()
        return [], None
    failed = []
    for case in ElementTree.parse(report).iter("testcase") if report.is_file() else ():
        for failure in (*case.iter("failure"), *case.iter("error")):
            failed.append((case.get("name"), failure.get("message", "").partition("\n")[0]))
    return failed, code


def plant(fault: Fault) -> Finding:
    """Run the finder of a fault in a copy of the project that has the fault."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="planted_") as folder:
        project = copied(Path(folder))
        path = place_of(fault, project)
        path.write_text(path.read_text(encoding="utf-8").replace(fault.snippet, fault.replacement), encoding="utf-8")
        failed, code = run_tests(project, ["-x", test_of(fault, project)], TIMEOUT)
        where = str(path.relative_to(project))
    seconds = time.perf_counter() - begin
    if not failed:
        why = {0: "", None: f": not over after {TIMEOUT:g} s"}.get(code, f": pytest ends with {code}")
        return Finding(fault, where, f"{NOT_FOUND}{why}", "", seconds)
    test, reason = failed[0]
    if any(word in reason.partition(": ")[0] for word in BROKEN):
        test = f"{NOT_FOUND}: it does not run ({reason})"
    return Finding(fault, where, test, reason, seconds)


def is_sound(faults: list[Fault]) -> bool:
    """Say whether the finders pass where nothing is planted."""
    with tempfile.TemporaryDirectory(prefix="sound_") as folder:
        project = copied(Path(folder))
        tests = list(dict.fromkeys(test_of(fault, project) for fault in faults))
        failed, code = run_tests(project, tests, TIMEOUT * len(tests))
    for test, reason in failed:
        print(f"fails without a fault: {test}: {reason}")
    print(f"{len(tests)} tests without a fault: {'all pass' if code == 0 else f'pytest ends with {code}'}")
    return code == 0


def write_table(path: Path, findings: list[Finding]) -> None:
    """Write one row for every fault (CSV)."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["fault", "what", "where", "right", "planted", "found_by", "reason", "seconds"])
        for one in findings:
            table.writerow([one.fault.name, one.fault.what, one.where, one.fault.snippet, one.fault.replacement,
                            one.found_by, one.reason, f"{one.seconds:.1f}"])


def page_of(findings: list[Finding]) -> str:
    """Return the page with one row for every fault (Markdown)."""
    found = sum(one.found for one in findings)
    rows = [f"| {one.fault.name} | {one.fault.what} | `{one.where}` | "
            f"{f'`{one.found_by}`' if one.found else f'**{one.found_by}**'} |" for one in findings]
    return "\n".join([*INTRODUCTION, f"{found} of {len(findings)} faults are found.", "",
                      "| fault | what is wrong | where | found by |", "|---|---|---|---|", *rows, ""])


def chosen_faults(names: list[str] | None) -> list[Fault]:
    """Return the faults of some names, or all; end with a sentence for each that is unknown or stale."""
    known = {fault.name: fault for fault in FAULTS}
    wrong = [f"no fault is called {name}; there are {', '.join(known)}" for name in names or () if name not in known]
    chosen = [known[name] for name in names or known if name in known]
    for fault in chosen:
        for look_up in (place_of, test_of):
            try:
                look_up(fault, ROOT)
            except LookupError as error:
                wrong.append(error.args[0])
    if wrong:
        sys.exit("\n".join(f"error: {sentence}" for sentence in wrong))
    return chosen


def main(arguments: list[str] | None = None) -> int:
    """Command line; the exit code is 0 if all faults are found."""
    parser = argparse.ArgumentParser(prog="python tests/planted_faults.py", description="Plant faults and see which "
                                                                                        "test finds each.")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="faults to plant, without writing the page")
    parser.add_argument("--output", type=Path, metavar="FILE.csv", help="table to write")
    parser.add_argument("--list", action="store_true", help="print the faults and the tests that should find them")
    parser.add_argument("--sound", action="store_true", help="only see that these tests pass without any fault")
    options = parser.parse_args(arguments)
    faults = chosen_faults(options.only)
    if options.list:
        for fault in faults:
            print(f"{fault.name} ({place_of(fault, ROOT).relative_to(ROOT)}): {fault.what}; {fault.finder}")
        return 0
    if options.sound:
        return 0 if is_sound(faults) else 1
    findings = []
    for fault in faults:
        findings.append(plant(fault))
        one = findings[-1]
        by = f"found by {one.found_by}" if one.found else one.found_by
        print(f"{fault.name} ({one.where}): {by} ({one.seconds:.0f} s)", flush=True)
    if options.output:
        write_table(options.output, findings)
    if not options.only:
        PAGE.write_text(page_of(findings), encoding="utf-8")
    found = sum(one.found for one in findings)
    print(f"{found} of {len(findings)} faults are found")
    return 0 if found == len(findings) else 1


if __name__ == "__main__":
    sys.exit(main())
