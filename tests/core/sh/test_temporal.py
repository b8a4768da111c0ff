"""MATHS §5: temporal filters."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_sh as reference

from lightwell.conventions import degree_of_index
from lightwell.settings import FilterKind, FilterSettings
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal
from lightwell.sh.minimum import minimum
from lightwell.sh.rotation import rotate
from lightwell.sh.temporal import Place, TemporalFilter, make_filter

SECOND = 1_000_000_000
START = 1_790_000_000 * SECOND
KINDS = ["none", "alpha", "tau", "one-euro", "kalman"]
seeds = st.integers(0, 2**32 - 1)


def make(kind: FilterKind, **options: Any) -> TemporalFilter:
    return make_filter(FilterSettings(kind=kind, **{"max_gap_seconds": 1000, **options}))


def frame(value: float, bands: int = 1) -> np.ndarray:
    """Coefficients with the mean ``value`` in every channel."""
    coefficients = np.zeros((bands**2, 3))
    coefficients[0] = value
    return coefficients


def response(kind: FilterKind, inputs: Any, fps: int = 30, **options: Any) -> np.ndarray:
    """Filter a sequence of scalars; returns one output a frame."""
    smooth = make(kind, **options)
    return np.array([smooth.update(frame(x), START + i * SECOND // fps)[0, 0] for i, x in enumerate(inputs)])


def norm(coefficients: np.ndarray) -> float:
    bands = int(np.sqrt(len(coefficients)))
    return float(np.linalg.norm(lambert_zonal(bands)[degree_of_index(bands), np.newaxis] * coefficients))


# Laws of every kind --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_first_frame_is_taken_as_it_is(kind: FilterKind) -> None:
    coefficients = np.random.default_rng(0).normal(size=(25, 3))
    smooth = make(kind)
    np.testing.assert_array_equal(smooth.update(coefficients, START), coefficients)
    assert smooth.cut


@given(seed=seeds, kind=st.sampled_from(KINDS))
@settings(max_examples=20, deadline=None)
def test_constant_input_is_a_fixed_point(seed: int, kind: FilterKind) -> None:
    coefficients = np.random.default_rng(seed).normal(size=(16, 3))
    smooth = make(kind)
    for i in range(5):
        np.testing.assert_array_equal(smooth.update(coefficients, START + i * SECOND // 30), coefficients)
        assert smooth.cut == (i == 0)


@given(seed=seeds, kind=st.sampled_from(KINDS))
@settings(max_examples=20, deadline=None)
def test_output_is_a_mean_of_inputs(seed: int, kind: FilterKind) -> None:
    # One gain, between 0 and 1, for everything: a common factor maps every coefficient of y onto that of x.
    generator = np.random.default_rng(seed)
    smooth = make(kind)
    previous = smooth.update(generator.normal(size=(9, 3)), START)
    for i in range(1, 6):
        given_frame = generator.normal(size=(9, 3))
        output = smooth.update(given_frame, START + i * SECOND // 30)
        gains = (output - previous) / (given_frame - previous)
        assert np.ptp(gains) < 1e-8
        assert -1e-12 <= gains.mean() <= 1 + 1e-12
        previous = output


@given(seed=seeds, kind=st.sampled_from(KINDS))
@settings(max_examples=15, deadline=None)
def test_no_new_negative_light(seed: int, kind: FilterKind) -> None:
    generator = np.random.default_rng(seed)
    smooth = make(kind)
    least = np.inf
    for i in range(8):
        light = np.outer(evaluate(reference.directions(1, seed + i)[0], 3), generator.uniform(0, 1, 3))
        light[0] += generator.uniform(0, 1, 3)
        least = min(least, *(minimum(channel)[0] for channel in light.T))
        output = smooth.update(light, START + i * SECOND // 30)
        assert min(minimum(channel)[0] for channel in output.T) >= least - 1e-12


def test_per_band_gains_would_make_negative_light() -> None:
    # Why the gain is common: mixing degrees of two non-negative lights at different rates is not a mean.
    first, second = evaluate([0, 0, 1], 2), evaluate([0, 0, -1], 2)
    first, second = first * [1, 0.5, 0.5, 0.5], second * [1, 0.5, 0.5, 0.5]
    second[0] *= 0.2
    second[1:] *= 0.2
    mixed = np.concatenate([[second[0]], first[1:]])
    cosine = lambert_zonal(2)[degree_of_index(2)]
    assert min(minimum(first * cosine)[0], minimum(second * cosine)[0]) >= -1e-15
    assert minimum(mixed * cosine)[0] < -0.1


@pytest.mark.parametrize("kind", KINDS)
def test_the_output_belongs_to_the_caller(kind: FilterKind) -> None:
    smooth = make(kind)
    smooth.update(frame(1.0), START)[:] = 7
    given_frame = frame(1.0)
    output = smooth.update(given_frame, START + SECOND // 30)
    assert output[0, 0] == 1
    given_frame[:] = 9
    assert smooth.update(frame(1.0), START + SECOND // 15)[0, 0] == 1


@pytest.mark.parametrize("kind", KINDS)
def test_black_light_and_light_after_darkness(kind: FilterKind) -> None:
    smooth = make(kind)
    for i in range(3):
        np.testing.assert_array_equal(smooth.update(frame(0.0), START + i * SECOND // 30), 0)
    output = smooth.update(frame(1.0), START + SECOND // 10)
    assert np.isfinite(output).all()
    assert output[0, 0] > 0
    for i in range(4, 60):
        output = smooth.update(frame(1.0), START + i * SECOND // 30)
    assert output[0, 0] > 0.8


@pytest.mark.parametrize("kind", KINDS)
def test_two_frames_with_one_time(kind: FilterKind) -> None:
    smooth = make(kind)
    smooth.update(frame(1.0), START)
    output = smooth.update(frame(2.0), START)
    assert not smooth.cut
    assert 1 <= output[0, 0] <= 2


# Starting anew -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("seconds", "cut"), [(1 / 30, False), (1.0, False), (1.0001, True), (-0.001, True), (-3600, True)]
)
def test_gaps_and_time_running_backwards(kind: FilterKind, seconds: float, cut: bool) -> None:
    smooth = make(kind, max_gap_seconds=1.0)
    smooth.update(frame(1.0), START)
    output = smooth.update(frame(2.0), START + round(seconds * SECOND))
    assert smooth.cut is cut
    if cut:
        assert output[0, 0] == 2


@pytest.mark.parametrize("kind", KINDS)
def test_cuts(kind: FilterKind) -> None:
    smooth = make(kind, cut_threshold=0.5, tau_seconds=1.0, alpha=30.0)
    cuts, outputs = [], []
    for i, light in enumerate([1.0, 1.49, 3.0, 1.0]):
        outputs.append(smooth.update(frame(light), START + i * SECOND // 30)[0, 0])
        cuts.append(smooth.cut)
    assert cuts == [True, False, True, True]
    assert outputs[2:] == [3, 1]


def test_cut_is_judged_by_what_a_diffuse_surface_shows() -> None:
    smooth = make("tau", cut_threshold=0.1)
    light = frame(1.0, bands=4)
    smooth.update(light, START)
    light[9:] = 100  # A_3 = 0
    smooth.update(light, START + SECOND // 30)
    assert not smooth.cut
    light[1] = 1
    smooth.update(light, START + SECOND // 15)
    assert smooth.cut


def test_no_threshold_means_no_cuts() -> None:
    smooth = make("tau", tau_seconds=1.0)
    smooth.update(frame(1.0), START)
    smooth.update(frame(1e6), START + SECOND // 30)
    assert not smooth.cut


@pytest.mark.parametrize("kind", KINDS)
def test_reset_and_another_number_of_bands_start_anew(kind: FilterKind) -> None:
    smooth = make(kind)
    smooth.update(frame(1.0, 3), START)
    smooth.reset()
    assert smooth.update(frame(5.0, 3), START + SECOND // 30)[0, 0] == 5
    assert smooth.cut
    assert smooth.update(frame(7.0, 5), START + SECOND // 15).shape == (25, 3)
    assert smooth.cut


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_refuses_frames_that_are_not_finite_and_goes_on(value: float) -> None:
    smooth = make("tau")
    smooth.update(frame(1.0), START)
    with pytest.raises(ValueError, match="NaN or Inf"):
        smooth.update(frame(value), START + SECOND // 30)
    assert smooth.update(frame(1.0), START + SECOND // 15)[0, 0] == 1


# Moving cameras ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_turning_camera_under_still_light_sees_still_light(kind: FilterKind) -> None:
    world = np.random.default_rng(3).normal(size=(16, 3))
    smooth = make(kind)
    for i in range(6):
        world_from_local = reference.rotation(i)
        local = rotate(world, world_from_local.T)
        output = smooth.update(local, START + i * SECOND // 30, world_from_local)
        np.testing.assert_allclose(output, world, rtol=0, atol=1e-13)


def test_refuses_a_reflection() -> None:
    with pytest.raises(ValueError, match="reflection"):
        make("tau").update(frame(1.0), START, np.diag([1, 1, -1]))


# alpha ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("alpha", [0.0, 1.0, 4.0, 9.0])
def test_alpha_impulse_response(alpha: float) -> None:
    pole = alpha / (1 + alpha)
    inputs = np.zeros(400)
    inputs[1] = 1
    outputs = response("alpha", inputs, alpha=alpha)[1:]
    k = np.arange(len(outputs))
    np.testing.assert_allclose(outputs, (1 - pole) * pole**k, rtol=1e-12, atol=1e-16)
    assert outputs.sum() == pytest.approx(1, abs=1e-12)
    assert outputs @ k == pytest.approx(alpha, abs=1e-9)  # mean delay, frames
    assert outputs @ outputs == pytest.approx(1 / (1 + 2 * alpha), rel=1e-12)  # white-noise variance


def test_alpha_noise_variance() -> None:
    noise = np.random.default_rng(0).normal(size=(20000, 25, 3))
    smooth = make("alpha", alpha=4.0)
    outputs = np.array([smooth.update(x, START + i * SECOND // 30) for i, x in enumerate(noise)])
    assert outputs[100:].var() == pytest.approx(1 / 9, rel=0.01)


@pytest.mark.parametrize(
    ("alpha", "frames", "ms25", "ms30"), [(1, 1.44, 58, 48), (4, 4.48, 179, 149), (9, 9.49, 380, 316)]
)
def test_time_constant_of_alpha(alpha: float, frames: float, ms25: float, ms30: float) -> None:
    steps = response("alpha", [0.0] + [1.0] * 200, alpha=float(alpha))[1:]
    measured = -1 / np.log((1 - steps[1]) / (1 - steps[0]))
    assert measured == pytest.approx(1 / np.log(1 + 1 / alpha), rel=1e-12)
    assert measured == pytest.approx(frames, abs=0.006)
    assert measured * 40 == pytest.approx(ms25, abs=0.6)
    assert measured * 1000 / 30 == pytest.approx(ms30, abs=0.6)


@pytest.mark.parametrize(("fps", "expected"), [(25, 0.965), (30, 0.982), (60, 0.9997)])
def test_alpha_depends_on_the_frame_rate(fps: int, expected: float) -> None:
    # 0.6 s after a step.
    outputs = response("alpha", [0.0] + [1.0] * (6 * fps // 10), fps, alpha=4.0)
    assert outputs[-1] == pytest.approx(expected, abs=5e-4)


# tau -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fps", [25, 30, 60])
def test_tau_does_not_depend_on_the_frame_rate(fps: int) -> None:
    # t = 3 τ after a step.
    outputs = response("tau", [0.0] + [1.0] * fps, fps, tau_seconds=1 / 3)
    assert outputs[-1] == pytest.approx(0.950212931632136, abs=1e-8)


def test_tau_with_irregular_frames() -> None:
    times = np.sort(np.random.default_rng(1).integers(1, SECOND, 40))
    smooth = make("tau", tau_seconds=0.2)
    smooth.update(frame(0.0), START)
    for time in [*times, SECOND]:
        output = smooth.update(frame(1.0), START + int(time))
        assert output[0, 0] == pytest.approx(1 - np.exp(-time / SECOND / 0.2), rel=1e-9)


def test_two_half_steps_are_one_step() -> None:
    halves, whole = make("tau", tau_seconds=0.1), make("tau", tau_seconds=0.1)
    for smooth in (halves, whole):
        smooth.update(frame(0.0), START)
    halves.update(frame(1.0), START + SECOND // 20)
    expected = whole.update(frame(1.0), START + SECOND // 10)
    np.testing.assert_allclose(halves.update(frame(1.0), START + SECOND // 10), expected, rtol=1e-14)


@pytest.mark.parametrize("alpha", [1.0, 4.0, 9.0])
def test_tau_and_alpha_agree_at_one_frame_rate(alpha: float) -> None:
    inputs = np.random.default_rng(0).normal(size=50)
    tau = 1 / 25 / np.log(1 + 1 / alpha)
    np.testing.assert_allclose(
        response("tau", inputs, 25, tau_seconds=tau), response("alpha", inputs, 25, alpha=alpha), rtol=0, atol=1e-14
    )


def test_linear_hold_follows_a_ramp_exactly() -> None:
    # x = t from rest: the low-pass of time constant τ answers t − τ(1 − e^(−t/τ)), whatever the frames' times are.
    tau = 0.2
    times = np.sort(np.random.default_rng(2).integers(1, SECOND, 30))
    linear, held = make("tau", tau_seconds=tau, hold="first"), make("tau", tau_seconds=tau)
    for smooth in (linear, held):
        smooth.update(frame(0.0), START)
    worst_linear, worst_held = 0.0, 0.0
    for nanoseconds in times:
        t = nanoseconds / SECOND
        exact = t - tau * (1 - np.exp(-t / tau))
        worst_linear = max(worst_linear, abs(linear.update(frame(t), START + int(nanoseconds))[0, 0] - exact))
        worst_held = max(worst_held, abs(held.update(frame(t), START + int(nanoseconds))[0, 0] - exact))
    assert worst_linear < 1e-8  # the clock counts whole nanoseconds
    assert worst_held > 0.01


@pytest.mark.parametrize("seconds", [1e-9, 1.99e-5, 2.01e-5, 0.03, 1.0])
def test_linear_hold_at_every_frame_rate(seconds: float) -> None:
    tau = 0.2
    smooth = make("tau", tau_seconds=tau, hold="first", max_gap_seconds=2.0)
    smooth.update(frame(0.0), START)
    t = round(seconds * SECOND) / SECOND
    exact = t + tau * np.expm1(-t / tau)
    assert smooth.update(frame(t), START + round(seconds * SECOND))[0, 0] == pytest.approx(exact, rel=1e-3, abs=1e-17)


def test_linear_hold_without_a_time_constant_does_not_filter() -> None:
    inputs = np.random.default_rng(0).normal(size=20)
    np.testing.assert_allclose(response("tau", inputs, tau_seconds=0.0, hold="first"), inputs, rtol=0, atol=1e-15)


def test_tau_of_zero_does_not_filter() -> None:
    inputs = np.random.default_rng(0).normal(size=20)
    np.testing.assert_allclose(response("tau", inputs, tau_seconds=0.0), inputs, rtol=0, atol=1e-15)


# one-euro ------------------------------------------------------------------------------------------------------------


def test_one_euro_at_rest_is_a_low_pass_at_the_lowest_cutoff() -> None:
    inputs = [1.0] + [1.0 + 1e-12] * 30
    outputs = response("one-euro", inputs, beta=0.0, min_cutoff_hz=0.5)
    np.testing.assert_allclose(
        (outputs[1:] - 1) / 1e-12, 1 - np.exp(-2 * np.pi * 0.5 * np.arange(1, 31) / 30), rtol=0, atol=2e-3
    )


def test_one_euro_follows_its_definition() -> None:
    inputs = np.abs(np.random.default_rng(0).normal(size=60)) + 1
    y, speed, expected = inputs[0], 0.0, [inputs[0]]
    for before, x in pairwise(inputs):
        speed += (1 - np.exp(-2 * np.pi / 30)) * (abs(x - before) * 30 / y - speed)
        y += (1 - np.exp(-2 * np.pi * (0.5 + 0.4 * speed) / 30)) * (x - y)
        expected.append(y)
    np.testing.assert_allclose(response("one-euro", inputs), expected, rtol=1e-6)


# kalman --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.01, 0.1, 1.0])
def test_kalman_settles_at_the_known_gain(ratio: float) -> None:
    # Noise is relative to the output, which stays at 1 to rounding.
    fps, measurement = 25, 0.001
    smooth = make("kalman", measurement_noise=measurement, process_noise=ratio * measurement * fps)
    smooth.update(frame(1.0), START)
    for i in range(1, 400):
        before = smooth.update(frame(1.0), START + i * SECOND // fps)[0, 0]
    after = smooth.update(frame(1.0 + 1e-6), START + 400 * SECOND // fps)[0, 0]
    gain = (-ratio + np.sqrt(ratio**2 + 4 * ratio)) / 2
    assert (after - before) / 1e-6 == pytest.approx(gain, rel=1e-6)
    # The pole 1 − K as a time constant in frames.
    assert -1 / np.log(1 - gain) == pytest.approx(1 / (2 * np.arcsinh(np.sqrt(ratio) / 2)), rel=1e-12)
    if ratio == 0.1:
        assert -1 / np.log(1 - gain) == pytest.approx(3.175, abs=5e-4)


def test_kalman_averages_its_first_frames() -> None:
    smooth = make("kalman", process_noise=1e-12, measurement_noise=1e-2)
    inputs = 1 + 0.01 * np.random.default_rng(0).normal(size=10)
    for i, x in enumerate(inputs):
        output = smooth.update(frame(x), START + i * SECOND // 30)[0, 0]
    assert output == pytest.approx(inputs.mean(), abs=1e-4)


# Switching a noisy light ---------------------------------------------------------------------------------------------


def switched(kind: FilterKind, **options: Any) -> tuple[float, int]:
    """The rms error before a switch, relative to the light, and frames from the switch to 90 %."""
    generator = np.random.default_rng(5)
    light: np.ndarray = np.outer(evaluate(reference.directions(1)[0], 3), [1.0, 0.9, 0.8])
    light[0] += 0.5
    smooth = make(kind, **options)
    errors = []
    for i in range(160):
        truth = light if i < 100 else 3 * light
        noise = generator.normal(size=light.shape)
        output = smooth.update(truth + 0.03 * norm(truth) / norm(noise) * noise, START + i * SECOND // 30)
        errors.append(norm(output - truth))
    before = np.sqrt(np.mean(np.square(errors[50:100]))) / norm(light)
    return float(before), int(np.argmax(np.array(errors[100:]) < 0.1 * norm(2 * light)))


def test_switched_light() -> None:
    raw, _ = switched("none")
    noise, frames = switched("tau", tau_seconds=0.3)
    assert raw == pytest.approx(0.03, rel=1e-9)
    assert noise < 0.4 * raw
    assert 15 <= frames <= 23
    noise, frames = switched("one-euro")
    assert noise < 0.55 * raw
    assert frames <= 2
    noise, frames = switched("kalman", process_noise=2e-4, measurement_noise=9e-4)
    assert noise < 0.55 * raw
    assert frames == 0


def test_gradients_are_followed_no_further_than_they_reach() -> None:
    """Also where the frame that follows has none: it says nothing of how far those of the one before hold."""
    c, slope = np.ones((4, 3)), np.full((4, 3, 3), 0.5)
    for metres, jumps in ((0.1, False), (4.0, True)):
        ours = make("tau", tau_seconds=10.0)
        ours.update(c, START, place=Place(slope, np.zeros(3), 0.2))
        after = ours.update(c, START + SECOND // 1000, place=Place(None, np.array([metres, 0, 0])))
        assert ours.cut == jumps
        np.testing.assert_allclose(after, c if jumps else c + 0.5 * metres, rtol=1e-3)
        assert ours.gradients is None
