"""Links: their rates, bursts and delays, the replay of a trace, and what a record may tell of them."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import estimable as es
from estimable import BernoulliLink, DelayLink, GilbertElliottLink, InputError, PerfectLink, Trace
from estimable.networks.delivery import transmit

N = 20_000
PACKETS = np.arange(N, dtype=float)[:, None]
KEY = jax.random.key(3)
PLANT = es.OutputError([0.523, 0.349], [0.440, 0.762], noise_variance=0.1, dt=1)
U = np.random.default_rng(0).normal(size=200)


def sent(link):
    return jax.tree_util.tree_map(np.asarray, transmit(link, PACKETS, KEY))


def runs_of(mask):
    """Lengths of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return edges[1::2] - edges[::2]


def test_a_perfect_link_changes_nothing():
    assert_array_equal(sent(PerfectLink()).value, PACKETS)


@pytest.mark.parametrize("link", [BernoulliLink(0.8), GilbertElliottLink.of_rate(0.8, burst=4), DelayLink([0.8, 0.1])])
def test_the_rate_is_as_asked(link):
    assert abs(np.mean(sent(link).delay == 0) - 0.8) < 0.025


@pytest.mark.parametrize(
    ("link", "length"), [(BernoulliLink(0.8), 1.25), (GilbertElliottLink.of_rate(0.8, burst=4), 4.0)]
)
def test_bursts_are_as_long_as_asked(link, length):
    lost = runs_of(sent(link).delay[:, 0] > 0)
    assert abs(lost.mean() - length) < 5 * lost.std() / np.sqrt(len(lost))


def test_each_channel_may_have_its_packet():
    delay = np.asarray(transmit(BernoulliLink([0.9, 0.3]), np.ones((N, 2)), KEY).delay)
    assert_array_equal(np.abs(np.mean(delay == 0, axis=0) - [0.9, 0.3]) < 0.02, True)
    assert abs(np.corrcoef((delay == 0).T)[0, 1]) < 0.03


def test_late_packets_come_when_they_come_unless_a_newer_one_has():
    value = np.asarray(transmit(Trace([0, 3, 1, 0, np.inf, 0], late="use"), PACKETS[:6], KEY).value)[:, 0]
    assert_array_equal(value, [0, np.nan, np.nan, 3, np.nan, 5])  # 1 and 2 come with 3, and are older
    dropped = np.asarray(transmit(Trace([0, 1, np.inf]), PACKETS[:3], KEY).value)[:, 0]
    used = np.asarray(transmit(Trace([0, 1, np.inf], late="use"), PACKETS[:3], KEY).value)[:, 0]
    assert_array_equal(dropped, [0, np.nan, np.nan])
    assert_array_equal(used, [0, np.nan, 1])


@pytest.mark.parametrize("late", ["use", "drop"])
def test_a_trace_does_again_what_was_done(late):
    delivery = sent(DelayLink([0.5, 0.2, 0.2], late=late))
    again = sent(Trace(delivery.delay, late=late))
    assert_array_equal(again.value, delivery.value)
    assert_array_equal(again.age, delivery.age)


def test_the_same_seed_loses_the_same_packets():
    one, two = (es.simulate(PLANT, U, seed=5, output_link=BernoulliLink(0.5)).record.y for _ in range(2))
    assert_array_equal(one, two)
    assert not np.array_equal(
        one, es.simulate(PLANT, U, seed=6, output_link=BernoulliLink(0.5)).record.y, equal_nan=True
    )


def test_links_leave_the_draws_of_the_plant_as_they_are():
    alone, linked = es.simulate(PLANT, U, seed=5), es.simulate(PLANT, U, seed=5, output_link=BernoulliLink(0.5))
    assert_array_equal(linked.measured, alone.record.y)
    seen = linked.record.seen
    assert_array_equal(linked.record.y[seen], alone.record.y[seen])


@pytest.mark.parametrize("lost", ["zero", "hold"])
@pytest.mark.parametrize("link", [BernoulliLink(0.5), DelayLink([0.4, 0.3, 0.2], late="use")], ids=["drop", "use"])
def test_a_record_tells_what_the_actuator_did(link, lost):
    simulation = es.simulate(PLANT, U, seed=1, input_link=link, lost=lost)
    assert_array_equal(simulation.record.applied(), simulation.applied)
    again = es.simulate(PLANT, U, seed=1, input_link=Trace(simulation.input_delay, late=link.late), lost=lost)
    assert_array_equal(again.record.y, simulation.record.y)


def test_of_inputs_that_are_not_acknowledged_a_record_does_not_know():
    record = es.simulate(PLANT, U, seed=1, input_link=BernoulliLink(0.5, acknowledged=False)).record
    assert np.all(np.isnan(record.arrived))
    assert_array_equal(record.u[:, 0], U)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: BernoulliLink(1.5), "`arrival` must be probabilities"),
        (lambda: GilbertElliottLink(0.0, 0.0), "so the initial state of the channel is undefined"),
        (lambda: GilbertElliottLink.of_rate(0.1, burst=2), "`burst` must be at least 9 packets"),
        (lambda: DelayLink([0.8, 0.4]), "`delays` must sum to at most 1"),
        (lambda: DelayLink([0.8], late="keep"), "`late` must be"),
        (lambda: Trace([0.5]), "`delay` must be (T, c)"),
        (lambda: es.simulate(PLANT, U, seed=1, input_link=BernoulliLink), "`input_link` must be a link"),
        (lambda: es.simulate(PLANT, U, seed=1, lost="keep"), "`lost` must be"),
        (
            lambda: es.simulate(PLANT, U, seed=1, input_link=DelayLink([0.5], late="use", acknowledged=False)),
            'a record can show which late packets were used (late = "use") only where they are acknowledged',
        ),
        (
            lambda: es.simulate(es.StateSpace([[0.5]], R=[[1.0]], dt=1), seed=1, steps=3, input_link=PerfectLink()),
            "the model has none",
        ),
    ],
)
def test_what_is_wrong_is_said(make, sentence):
    with pytest.raises(InputError) as caught:
        make()
    assert sentence in str(caught.value)
