"""Which entries of a state stay what they were."""

import jax.numpy as jnp
import numpy as np

from estimable.engines.program.constant_state import constant_entries
from estimable.engines.program.straight_line import lower

START = {(1, i): value for i, value in enumerate([0.0, 0.0, 0.0, 2.0, 0.0, 1.0])}


def step(x, state):
    """Entry 1 takes what arrives, 2 and 4 what was in 1 and 2; 3 is counted; 0 and 5 stay, 0 because 4 is taken 0 times."""
    s = state
    return jnp.stack([s[0] * s[4], x * s[5], s[1], s[3] + s[5], s[2], jnp.where(s[0] == 0, s[5], x)])


def by_lowering_again(known):
    while True:
        row = lower(step, np.zeros(()), np.zeros(6), known=known)
        after = [row.operations[name] for name in row.outputs[0]]
        kept = {p: v for p, v in known.items() if after[p[1]].name == "constant" and after[p[1]].value == v}
        if len(kept) == len(known):
            return kept
        known = kept


def test_what_lasts_is_found_as_by_lowering_the_step_until_nothing_changes():
    kept = constant_entries(START, lower(step, np.zeros(()), np.zeros(6)), 1)
    assert kept == by_lowering_again(START) == {(1, 0): 0.0, (1, 5): 1.0}


def test_nothing_known_is_nothing_kept():
    assert constant_entries({}, lower(step, np.zeros(()), np.zeros(6)), 1) == {}
