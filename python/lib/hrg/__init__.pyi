import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from os import PathLike
from typing import IO, Any

from . import plot as plot

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

class HrgError(ValueError):
    """An input that cannot be used: one sentence that says what, where and what to do."""

# Whatever is a recording: itself, a path, an open file, a frame, a mapping of columns.
Source = Any

class Recording:
    """One power-on of a unit in the chamber. It never changes; its arrays look into it and cannot be written to."""

    @property
    def columns(self) -> list[str]:
        """Names of the columns that are there."""
    @property
    def meta(self) -> dict[str, str]:
        """Metadata of the columns as they are here: `earth_rate` is "removed" where the earth's rate was taken off them."""
    @property
    def unit(self) -> str:
        """Name of the unit; "unnamed" where nobody has told it."""
    @property
    def axes(self) -> list[str]:
        """Axes that there are, of "x", "y", "z"."""
    @property
    def notes(self) -> list[str]:
        """What was found and taken out on the way, one sentence each."""
    @property
    def earth_rate_dph(self) -> tuple[float, float, float] | None:
        """Earth's rate along the axes that was taken off the rates, deg/h; None where the attitude is not known."""
    def __len__(self) -> int: ...
    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """A column, cleaned; NaN where a value is missing. Shape (rows,), no copy."""
    def to_dict(self) -> dict[str, NDArray[np.float64]]:
        """All columns, cleaned, the earth's rate taken off where the attitude is known; with `meta` they make the same recording again."""
    def to_csv(self) -> str:
        """The recording as it was read, as text."""
    def write(self, path: str | PathLike[str]) -> None:
        """Writes it: Parquet where the path ends in .parquet, else text."""
    def split(self, at_s: float) -> tuple[Recording, Recording]:
        """Two parts: what is before a time to learn from, and what is after to judge on, with the states carried on."""

class Corrected:
    """What a unit would have sent, a row each second. Axes are x, y, z."""

    @property
    def time_s(self) -> NDArray[np.float64]:
        """End of each second, s. Shape (seconds,)."""
    @property
    def corrected_dph(self) -> NDArray[np.float32]:
        """Mean corrected rates, deg/h. Shape (seconds, 3)."""
    @property
    def raw_dph(self) -> NDArray[np.float32]:
        """Mean raw rates, deg/h. Shape (seconds, 3)."""
    @property
    def bias_dph(self) -> NDArray[np.float32]:
        """Biases that this second gave, deg/h; they hold in the next. Shape (seconds, 3)."""
    @property
    def bias_std_dph(self) -> NDArray[np.float32]:
        """Their standard uncertainties, deg/h; NaN where the calibration does not state them. Learnt from one train run, they do not hold the
        constant that changes with each power-on. Shape (seconds, 3)."""
    @property
    def temperature_c(self) -> NDArray[np.float32]:
        """Temperatures of the gyros, C. Shape (seconds, 3)."""
    @property
    def status(self) -> NDArray[np.uint16]:
        """Status bits of x, y, z and the unit. Shape (seconds, 4)."""
    @property
    def notes(self) -> list[str]: ...
    def __len__(self) -> int: ...
    def to_dict(self) -> dict[str, NDArray[Any]]:
        """A column for each axis: temp_?_c, raw_?_dph, rate_?_dph (corrected), bias_?_dph, bias_std_?_dph, status_?."""
    def to_csv(self) -> str:
        """The file that `hrg correct` writes."""
    def write(self, path: str | PathLike[str]) -> None: ...

class Calibration:
    """Coefficients of a unit: what is fitted, burnt and flown."""

    @staticmethod
    def read(path: str | PathLike[str]) -> Calibration:
        """Reads a calibration file (TOML) or an image."""
    @staticmethod
    def from_toml(text: str) -> Calibration: ...
    @staticmethod
    def from_bytes(image: bytes) -> Calibration:
        """From the image that a unit keeps in flash."""
    def to_toml(self) -> str: ...
    def to_bytes(self) -> bytes:
        """The image that a unit keeps in flash."""
    def write(self, path: str | PathLike[str]) -> None:
        """Writes it: the image where the path ends in .bin, else text."""
    @property
    def unit(self) -> str: ...
    @property
    def checksum(self) -> int:
        """Checksum of the image: its identity in log and housekeeping."""
    @property
    def created_unix_s(self) -> int: ...
    @property
    def notes(self) -> list[str]:
        """What the fit had to say."""
    @property
    def effects(self) -> list[dict[str, Any]]:
        """Effects beyond the baseline: name, parameters, gains_dph of each axis (deg/h per unit of the regressor)."""
    @property
    def temperature_range_c(self) -> tuple[float, float]:
        """Lowest and highest temperature that every axis was fitted on, C."""
    def bias(self, temp_c: ArrayLike, ramp_c_per_min: ArrayLike = 0.0, *, std: bool = False) -> Any:
        """Bias that the unit would subtract at temperatures (C), deg/h, shape (temperatures, 3): on a soak, or where a ramp has led to them
        after a soak (an hour of it, or less where it would begin far outside the calibrated range). NaN far outside. With std=True its
        standard uncertainty beside it."""
    def predict(self, recording: Source) -> NDArray[np.float32]:
        """Bias of each second of a recording, deg/h, shape (seconds, 3)."""
    def score(self, recording: Source) -> float:
        """Share of the variance of the raw rates' 100 s means that it removes from a recording, mean of the axes."""

class Report:
    """What a trace found. Every key of `to_dict()` is an attribute, too (`final` as `final_`). In a notebook it shows itself."""

    @property
    def verdict(self) -> str: ...
    @property
    def calibration(self) -> Calibration | None:
        """The image to burn; None where no image beats the raw rates."""
    @property
    def baseline_calibration(self) -> Calibration: ...
    verdict_kind: str
    burn: bool
    effects: list[dict[str, Any]]
    notes: list[str]
    advice: list[str]
    def to_dict(self) -> dict[str, Any]: ...
    def to_json(self) -> str:
        """The file that `hrg trace --out` writes."""
    def to_html(self) -> str:
        """The page that `hrg trace --html` writes."""
    def __getattr__(self, name: str) -> Any: ...

class Figures:
    """Figures with the page that shows them: each key of `to_dict()` is an attribute; `str()` is the table; in a notebook it shows itself."""

    def to_dict(self) -> dict[str, Any]: ...
    def to_json(self) -> str: ...
    def to_html(self) -> str: ...
    @property
    def calibrations(self) -> dict[str, Calibration]:
        """Of a comparison: what each method has fitted. Else empty."""
    def __getattr__(self, name: str) -> Any: ...

@dataclasses.dataclass(frozen=True)
class States:
    """What an own effect may look at: one axis of one run, a value each second, shape (seconds,); NaN where it is not known."""

    axis: str
    step_s: float
    time_s: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    ramp_c_per_min: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    temperatures_c: NDArray[np.float64]
    case_c: NDArray[np.float64]
    board_c: NDArray[np.float64]
    supply_v: NDArray[np.float64]
    drive_v: NDArray[np.float64]
    quad_v: NDArray[np.float64]

class OwnEffect:
    """An effect of your own, for `trace(own_effects=[...])`: columns of states in, columns out. `parameter`: a name with unit, and the values to try."""

    name: str
    function: Callable[..., ArrayLike]
    parameter: tuple[str, list[float]] | None
    def __init__(
        self, name: str, function: Callable[..., ArrayLike], *, parameter: tuple[str, Sequence[float]] | None = None
    ) -> None: ...

class LinkDecoder:
    """The link of a unit, piece by piece."""

    def __init__(self) -> None: ...
    @property
    def errors(self) -> int:
        """Frames so far that were not good."""
    def push(self, data: bytes) -> list[dict[str, Any]]:
        """Messages that end in these bytes: rate and housekeeping, their fields by the names of docs/formats.md."""

class LogDecoder:
    """The log of a unit."""

    def __init__(self, elf: str | PathLike[str] | None = None) -> None: ...
    def lines(self, data: bytes) -> list[str]:
        """Lines that end in these bytes of a raw stream."""
    @staticmethod
    def second(line: str) -> dict[str, Any] | None:
        """The second that a line tells."""

def read(
    source: str | PathLike[str] | IO[str] | IO[bytes],
    *,
    unit: str | None = None,
    latitude_deg: float | None = None,
    axes: str | None = None,
    scale_factor_dph_per_code: Sequence[float] | None = None,
) -> Recording: ...
def from_table(
    table: Mapping[str, ArrayLike] | Any,
    meta: Mapping[str, object] | None = None,
    *,
    name: str = "",
    unit: str | None = None,
    latitude_deg: float | None = None,
    axes: str | None = None,
    scale_factor_dph_per_code: Sequence[float] | None = None,
) -> Recording: ...
def to_pandas(recording: Recording | Corrected) -> Any: ...
def import_table(path: str | PathLike[str], map: str, *, imu: int | None = None) -> Recording:
    """Another program's file by a map: the path of one, or px4, ardupilot, ardupilot-tcal, ros, betaflight, adis, bosch. `imu`: its number, from
    0, where the file has several."""

def simulate(
    profile: str = "dong",
    *,
    effects: Sequence[str] = (),
    unit: int = 1,
    seed: int = 1,
    kind: str = "hrg",
    thermometer: str = "frequency",
    white_100s_dph: float | None = None,
    defects: bool = False,
) -> tuple[Recording, dict[str, Any]]:
    """A simulated chamber run, and what it does not tell: floor_dph (deg/h, standard deviation of 100 s means of the noise)
    and gains_dph of the effects. Effects are written as for `hrg simulate --effect`."""

def fit(
    recordings: Source | Sequence[Source],
    method: str = "lsq",
    *,
    seed: int = 1,
    uniform: bool = False,
    breakpoint_c: float | None = None,
    curve: Calibration | None = None,
    different_units: bool = False,
    progress: Callable[[int, int], object] | None = None,
) -> Calibration:
    """Coefficients of a bias model by a method of `methods()`."""

def methods() -> list[str]: ...
def trace(
    train: Source | Sequence[Source],
    verify: Source,
    *,
    in_use: Calibration | None = None,
    judge: Source | None = None,
    exchange: bool = False,
    repeat_is_enough: bool = False,
    different_units: bool = False,
    jobs: int | None = None,
    progress: Callable[[int, int], object] | None = None,
    own_effects: Sequence[OwnEffect] = (),
    limit_dph: float | None = None,
    prior: str | PathLike[str] | None = None,
) -> Report: ...
def compare(
    train: Source | Sequence[Source],
    verify: Source | Sequence[Source],
    *,
    out: str | PathLike[str] | None = None,
    own: Mapping[str, Callable[[list[Recording], Recording], ArrayLike]] | None = None,
    methods: Sequence[str] | None = None,
    seed: int = 1,
    from_s: float = 0.0,
    different_units: bool = False,
    progress: Callable[[int, int], object] | None = None,
) -> Figures:
    """Every method on the same data."""

def judge(
    runs: Source | Sequence[Source],
    calibration: Calibration,
    limit_dph: float,
    from_c: float,
    to_c: float,
    *,
    means_s: int = 100,
    different_units: bool = False,
) -> Figures:
    """Does the unit pass? `verdict` is "PASS", "FAIL" or "NOT COVERED"; `axes` has the figures."""

def data_sheet(recordings: Source | Sequence[Source]) -> Figures:
    """Figures of a data sheet from recordings alone, with intervals."""

def soaks(
    recordings: Source | Sequence[Source], *, settled_c_per_min: float = 0.01, hold_s: float = 600.0
) -> dict[str, NDArray[np.float64]]:
    """The soaks of recordings as a table of static points, shape (soaks,) each."""

def accelerometers(
    path: str | PathLike[str], *, latitude_deg: float, gravity_mps2: float | None = None
) -> dict[str, Any]:
    """Bias, scale and cross-axis of a platform's accelerometers, from a table of tilts (a1_mps2, a2_mps2, tilt1_arcmin, tilt2_arcmin): for `align`."""

def correct(recording: Source, calibration: Calibration, *, different_units: bool = False) -> Corrected:
    """What a unit with this calibration would have sent, to the last bit."""

def allan(source: Source | ArrayLike, step_s: float | None = None) -> dict[str, dict[str, Any]]:
    """Overlapping Allan deviation by axis ("x" for a plain array of rates in deg/h, `step_s` apart): tau_s, deviation_dph, low_dph and
    high_dph (one sigma), shape (points,); angle_random_walk_deg_per_root_h, bias_instability_dph, rate_random_walk_dph_per_root_h (None: does not show)."""

def align(
    path: str | PathLike[str],
    filter: str = "linear",
    *,
    drift_dph: float | None = None,
    tilt_arcmin: float | None = None,
    accelerometers: Calibration | dict[str, Any] | str | PathLike[str] | None = None,
    first_azimuth_deg: float = 0.0,
    seed: int = 1,
) -> dict[str, Any]:
    """Azimuth, tilts and drifts of a platform at rest, from a recording in two positions. `accelerometers`: what is taken out of the
    velocities, as `accelerometers()` gave it, a file of it, or a calibration that holds it. `first_azimuth_deg`: of the filter ekf;
    `seed`: of the literal particle filter."""

def points(path: str | PathLike[str]) -> dict[str, Any]:
    """Fits of frequency over temperature from a table of static points."""

def effects() -> list[dict[str, Any]]:
    """The effects of the library: name, id, class, equation (with state and source), parameters, outputs, reach ("unit", "needs-input", "unpredictable"), needs, remembers_path."""

def decode_link(chunks: bytes | Iterable[bytes]) -> Iterator[dict[str, Any]]: ...
def decode_log(lines: str | bytes | Iterable[str] | Iterable[bytes], elf: str | PathLike[str] | None = None) -> Iterator[dict[str, Any]]: ...
