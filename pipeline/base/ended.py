"""Program: tell of a stage that a signal has ended, and leave with its exit code.

    python -m pipeline.base.ended CODE -m pipeline.<stage> ...

A process that the system kills for its memory, or whose library crashes, cannot say so itself.
"""
import sys

from pipeline.base.memory import sentence_of_signal


def main(code: int, command: list[str]) -> int:
    """Print the sentence, if there is one, and return the exit code."""
    stage = next((word for word in command if word.startswith("pipeline.")), "python").rpartition(".")[2]
    if code > 128 and (sentence := sentence_of_signal(code - 128, stage)):
        print(f"error: {sentence}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), sys.argv[2:]))
