"""Mistakes on a command line end in one sentence, as all others do."""
import subprocess
import sys

import pytest
from conftest import ROOT

from pipeline.base.cli import CommandLine, stage_parser
from pipeline.base.errors import UserError


@pytest.fixture
def command() -> CommandLine:
    """Return a command with an option, a choice and a file."""
    parser = stage_parser("stage", "Do something.")
    parser.add_argument("file")
    parser.add_argument("--output", type=float)
    parser.add_argument("--side", choices=["right", "left"])
    return parser


@pytest.mark.parametrize("words, sentence", [
    ("a --outptu=3", r"unrecognized arguments: --outptu=3 \(did you mean --output\?\)"),
    ("a --side lft", r"argument --side: invalid choice: 'lft' \(choose from '?right'?, '?left'?\) "
                     r"\(did you mean left\?\)"),
    ("a --output much", "argument --output: invalid float value: 'much'"),
    ("a b", "unrecognized arguments: b"),
    ("", "the following arguments are required: file"),
])
def test_a_mistake_is_told_with_what_was_meant(command, words, sentence, capsys):
    with pytest.raises(UserError, match=rf"^python -m pipeline\.stage: {sentence}; --help lists what it takes$"):
        command.parse_args(words.split())
    assert capsys.readouterr() == ("", "")


def test_commands_within_a_command_tell_it_too():
    parser = stage_parser("stage", "Do something.")
    parser.add_subparsers(required=True, dest="what").add_parser("show")
    with pytest.raises(UserError, match=r"\(did you mean show\?\); --help"):
        parser.parse_args(["shw"])


def test_options_that_snakemake_does_not_know_are_told_without_all_that_it_does():
    done = subprocess.run([sys.executable, "-m", "pipeline.workflow.start", "--dry-rn", "all"], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == ("error: snakemake: unrecognized arguments: --dry-rn (did you mean --dry-run?); --help lists "
                           "what it takes\n")
