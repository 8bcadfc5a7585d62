"""Autoregressive models of a texture from a recording of a finger or a tool that slides over it.

The recording is cut into windows of steady speed and force. Windows with similar speed and force give one model
(Yule-Walker on their mean autocovariance), labelled with their medians. All models have the order with the lowest sum
of BIC, so that line spectral frequencies can be interpolated (H. Culbertson, J. Unwin, K. J. Kuchenbecker, IEEE Trans.
Haptics 7 (2014) 381-393, who segment by the signal instead). A speed in the middle is predicted from the others.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy  # loads its subpackages on first use
from scipy.signal import butter, sosfiltfilt

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.specimens import check_one_body
from palpate.nodes.base.texture_file import Model, Texture, tabulate_texture
from palpate.physics.table_file import read_table
from palpate.physics.texture.autoregressive import line_spectrum, spectrum, yule_walker
from palpate.physics.texture.surface import third_octaves
from palpate.units.header import examples, split_unit

WINDOW = 0.1  # [s]
STEADY = 0.2  # [1] largest relative change of speed and force in a window that is used
RATIO = 1.25  # [1] largest ratio of the speeds, and of the forces, of one model
LEAST = 8  # smallest number of windows of a model
ORDERS = range(4, 41)
LOWEST = 20.0  # [Hz] high-pass limit; the motion of the hand is below
SLOWEST = 2  # fluctuations from which the interval follows
ENOUGH = 60  # smallest number of windows for which an interval is given
SI = {"t": "s", "speed": "m/s", "normal": "N", "lateral": "N", "acceleration": "m/s^2"}
"""SI units of the columns, which are those of a header without units."""
LARGEST = {"speed": 5.0, "normal": 100.0, "lateral": 100.0}
"""[m/s], [N] Limits of a stroke by a hand; a larger value means a wrong unit."""
MOST_FRICTION = 20.0  # [1] lateral over normal force; a larger value means a wrong unit
NEEDED, MEASURED = {"t", "speed", "normal"}, {"lateral", "acceleration"}


class RecordedCell(NamedTuple):
    """Windows (n, w) of a vibration at a speed [m/s] and a force [N]."""

    speed: float
    force: float
    windows: np.ndarray


def fit_texture(
    path: Path, held_out: float | None = None, notes: list[str] | None = None, dialect: str = ""
) -> Texture:
    """The models of a table with the columns t, speed, normal, and lateral or acceleration, in SI units or with units.

    held_out  speed [m/s] that is predicted from the others; None: one in the middle
    notes     takes which lines were not read
    dialect   of the numbers, if it cannot be detected: one of `table_numbers.DIALECTS`

    SessionError: an unusable file, or an unknown speed.
    """
    try:
        sampling, quantity, cells = _cells(path, [] if notes is None else notes, dialect)
    except OSError as error:
        raise SessionError(f"{path}: {error.strerror}") from None
    except ValueError as error:
        raise SessionError(f"{path}: {error}") from None
    models = _models(cells, sampling)
    speeds = np.unique([cell.speed for cell in cells])
    groups = _groups(speeds)
    if held_out is not None:
        nearest = groups[np.argmin(np.abs(speeds - held_out))]
        if not 1 / RATIO < speeds[groups == nearest].mean() / held_out < RATIO:
            raise SessionError(f"--held-out: found {held_out:g} m/s; the models have the speeds {_list(speeds)} m/s")
    elif groups[-1] < 2:
        return Texture(sampling=sampling, quantity=quantity, models=tuple(models))
    else:
        nearest = groups[-1] // 2
    away = speeds[groups == nearest]
    kept = [cell for cell in cells if cell.speed not in away]
    if not kept:
        raise SessionError(f"--held-out: {_list(away)} m/s is the only speed of {path}")
    fewer = Texture(sampling=sampling, quantity=quantity, models=tuple(_models(kept, sampling)))
    errors = np.mean([_errors(fewer, cell) for cell in cells if cell.speed in away], axis=0)
    prediction = tuple((round(float(f), 1), round(float(e), 2)) for f, e in errors)
    return Texture(
        sampling=sampling, quantity=quantity, models=tuple(models), held_out=(float(away.mean()), prediction)
    )


def _names(cells: Sequence[str]) -> set[str]:
    return {split_unit(cell)[0].lower() for cell in cells}


def _list(numbers: np.ndarray) -> str:
    return ", ".join(f"{number:.3g}" for number in numbers)


def _cells(path: Path, notes: list[str], dialect: str) -> tuple[float, str, list[RecordedCell]]:
    """Sampling [Hz], quantity, and the windows by speed and force."""
    table, lines, measured = _strokes(path, notes, dialect)
    sampling = _sampling(table[:, 0], lines)
    width = round(WINDOW * sampling)
    if sampling < 4 * LOWEST or len(table) < LEAST * width:
        raise ValueError(f"found {len(table)} rows at {sampling:.4g} Hz; expected {LEAST * WINDOW:g} s and more, at "
                         f"{4 * LOWEST:g} Hz and more")  # fmt: skip
    at, windows = _steady(table, sampling, width)
    label, cells = np.array([_groups(row) for row in at]), []
    for each in np.unique(label, axis=1).T:
        mine = (label == each[:, None]).all(axis=0)
        if mine.sum() >= LEAST:
            cells.append(RecordedCell(float(np.median(at[0, mine])), float(np.median(at[1, mine])), windows[mine]))
    if not cells:
        raise ValueError(f"no speed and force are steady within {100 * STEADY:g} % for {LEAST} windows of {WINDOW:g} s")
    return sampling, "acceleration" if measured == "acceleration" else "force", cells


def _strokes(path: Path, notes: list[str], dialect: str) -> tuple[np.ndarray, Sequence[int], str]:
    """The columns t, speed, normal and the measured one (n,4) in SI units, the rows of the file, and what is measured.
    ValueError: a column is missing, doubled or in another unit."""
    found = read_table(path, lambda cells: len(NEEDED & _names(cells)) + bool(MEASURED & _names(cells)), 4, dialect)
    names = [name.lower() for name in found.names]
    measured = next((name for name in ("acceleration", "lateral") if name in names), "lateral")
    wanted = ("t", "speed", "normal", measured)
    if missing := [name for name in wanted if name not in names]:
        raise ValueError(f"found the columns {', '.join(names)}; expected {', '.join(missing)} too")
    if twice := [name for name in wanted if names.count(name) > 1]:
        raise ValueError(f"row {found.line}: two columns {twice[0]!r}; expected one")
    places = [names.index(name) for name in wanted]
    check_one_body(path, found, "strokes over one texture")
    table, lines = found.values(places, places[0])
    notes += found.skipped
    for name, place, column in zip(wanted, places, table.T, strict=True):
        column *= found.factor(place, SI[name]) or 1.0
        worst = int(np.argmax(np.abs(column))) if len(column) else 0
        if len(column) and name in LARGEST and abs(column[worst]) > LARGEST[name]:
            si = SI[name]
            raise ValueError(
                f"row {lines[worst]}, column {name!r}: found {column[worst]:.4g} {si}, expected at most "
                f"{LARGEST[name]:g} {si}; name the unit in the header: `{name} [UNIT]`, with {examples(si)} or another "
                "as UNIT"
            )
    if len(table) < 3:
        raise ValueError(
            f"{len(table)} rows after the header in row {found.line}, expected {LEAST * WINDOW:g} s and more"
        )
    normal, lateral = (float(np.median(np.abs(column))) for column in table[:, 2:].T)
    if measured == "lateral" and lateral > MOST_FRICTION * normal > 0.0:
        raise ValueError(f"column 'lateral': found {lateral / normal:.3g} times the normal force, expected at most "
                         f"{MOST_FRICTION:g} times; are both units right?")  # fmt: skip
    return table, lines, measured


def _sampling(time: np.ndarray, lines: Sequence[int]) -> float:
    """Sampling [Hz] of times [s] (n,). ValueError: unequal steps."""
    step = np.diff(time)
    usual = float(np.median(step))
    uneven = np.flatnonzero(np.abs(step - usual) >= 0.05 * usual)
    if len(uneven):
        k = int(uneven[0])
        raise ValueError(f"row {lines[k + 1]}, column 't': found a step of {step[k]:.4g} s, expected equal steps, here "
                             f"of {abs(usual):.4g} s")  # fmt: skip
    return float(1.0 / np.mean(step))


def _steady(table: np.ndarray, sampling: float, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Median speed and force (2,n) and the fluctuation (n,width) of the windows in which both are steady."""
    signal = sosfiltfilt(butter(4, LOWEST, "highpass", fs=sampling, output="sos"), table[:, 3])
    count = len(table) // width
    speed, force, windows = (
        column[: count * width].reshape(count, width) for column in (np.abs(table[:, 1]), table[:, 2], signal)
    )
    at = np.array([np.median(speed, axis=1), np.median(force, axis=1)])
    moves = np.array([np.ptp(speed, axis=1), np.ptp(force, axis=1)])
    good = (at > 0.0).all(axis=0) & (moves < STEADY * at).all(axis=0) & (windows.std(axis=1) > 0.0)
    return at[:, good], windows[good]


def _groups(values: np.ndarray) -> np.ndarray:
    """Group number (n) of each value (n) > 0. The largest value of a group is at most RATIO times the smallest."""
    numbers, number, begin = np.zeros(len(values), int), -1, 0.0
    for i in np.argsort(values):
        if number < 0 or values[i] > RATIO * begin:
            number, begin = number + 1, values[i]
        numbers[i] = number
    return numbers


def _models(cells: list[RecordedCell], sampling: float) -> list[Model]:
    """A model of each cell; all have the order with the lowest sum of BIC."""
    most = min(ORDERS[-1], cells[0].windows.shape[1] // 8)
    covariances = [_covariance(cell.windows, most) for cell in cells]
    bic = np.zeros(most + 1)
    for cell, covariance in zip(cells, covariances, strict=True):
        size = cell.windows.size
        bic += size * np.log(yule_walker(covariance)[1]) + np.log(size) * np.arange(most + 1)
    order = ORDERS[0] + int(np.argmin(bic[ORDERS[0] :]))
    models = []
    for cell, covariance in zip(cells, covariances, strict=True):
        power = np.mean(cell.windows**2, axis=1)
        lsf = tuple(float(x) for x in line_spectrum(yule_walker(covariance[: order + 1])[0]))
        rms = float(np.sqrt(power.mean()))
        models.append(Model(speed=cell.speed, force=cell.force, rms=rms, lsf=lsf, interval=rms_interval(power)))
    return models


def rms_interval(power: np.ndarray) -> tuple[float, float] | None:
    """95 % interval of the rms from the powers (n) > 0 of n successive windows; None below `ENOUGH` windows, where a
    gain that wanders within 0.3 s or more is not seen.

    Neighbouring windows are not independent: the gain of a stroke wanders, and a narrow band rings over a window. The
    variance of the mean is therefore that of the slowest fluctuations, the first B = 2 cosines of the n logarithms,

        c_j = sqrt(2/n) sum_k ln(power_k) cos(pi j (k - 1/2)/n),    s^2 = mean(c_j^2)/n,    ln power = ln mean +- t_B s

    with Student's t of B degrees of freedom (U. K. Mueller, J. Econometrics 141 (2007) 1331-1352). It is nominal where
    the windows forget within n/B; a wander that outlasts the stroke cannot be seen in it.
    """
    n, level = len(power), np.log(power)
    if n < ENOUGH:
        return None
    order = np.arange(1, SLOWEST + 1)[:, None]
    cosines = np.sqrt(2.0 / n) * np.cos(np.pi * order * (np.arange(n) + 0.5) / n) @ level
    half = float(scipy.stats.t.ppf(0.975, SLOWEST) * np.sqrt(np.mean(cosines**2) / n))
    middle = float(np.log(power.mean()))
    return float(np.exp(0.5 * (middle - half))), float(np.exp(0.5 * (middle + half)))


def _covariance(windows: np.ndarray, most: int) -> np.ndarray:
    """Mean autocovariance (most + 1) of windows (n, w) under a Hann taper."""
    tapered = windows * np.hanning(windows.shape[1])
    power = np.mean(np.abs(np.fft.rfft(tapered, 2 * windows.shape[1], axis=1)) ** 2, axis=0)
    found = np.fft.irfft(power)[: most + 1]
    found[0] *= 1.0 + 1e-9
    return found


def _errors(texture: Texture, cell: RecordedCell) -> np.ndarray:
    """Third-octave bands [Hz] and the error of the predicted level [dB] in each (n, 2)."""
    speeds, forces, table = tabulate_texture(texture)
    row = table[np.argmin(np.abs(speeds - cell.speed)), np.argmin(np.abs(forces - cell.force))]
    width = cell.windows.shape[1]
    frequency = np.fft.rfftfreq(4 * width, 1.0 / texture.sampling)
    taper = np.hanning(width)
    found = np.mean(np.abs(np.fft.rfft(cell.windows * taper, 4 * width, axis=1)) ** 2, axis=0)
    found *= 2.0 / (texture.sampling * np.sum(taper**2))
    wanted = spectrum(row[:-1], row[-1], texture.sampling, frequency)
    bands = third_octaves(2 * LOWEST, 0.45 * texture.sampling)
    inside = [(frequency >= centre / 10**0.05) & (frequency < centre * 10**0.05) for centre in bands]
    return np.array(
        [(b, 10.0 * np.log10(wanted[i].sum() / found[i].sum())) for b, i in zip(bands, inside, strict=True)]
    )
