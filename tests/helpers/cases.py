"""Cases of tests that `./run test` leaves out."""
import pytest


def thorough(*values: object):
    """Return a case of `pytest.mark.parametrize` that is left to `./run test -m 'not slow'`, as a whole test is by
    `@pytest.mark.thorough`.
    """
    return pytest.param(*values, marks=pytest.mark.thorough)
