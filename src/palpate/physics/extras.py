"""The extras of palpate: which optional packages each installs, and the command that installs it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

EXTRAS = {
    "devices": {"pyusb": "usb", "hidapi": "hid", "websockets": "websockets"},
    "page": {"websockets": "websockets"},
    "gym": {"gymnasium": "gymnasium"},
    "view": {"matplotlib": "matplotlib", "pyvista": "pyvista"},
    "scan": {
        "scikit-image": "skimage",
        "pydicom": "pydicom",
        "nibabel": "nibabel",
        "pynrrd": "nrrd",
        "matplotlib": "matplotlib",
    },
    "export": {"pyarrow": "pyarrow", "pillow": "PIL"},
    "table": {"pandas": "pandas"},
    "sheets": {"openpyxl": "openpyxl"},
    "film": {"pyvista": "pyvista", "matplotlib": "matplotlib", "imageio-ffmpeg": "imageio_ffmpeg", "pillow": "PIL"},
    "mesh": {
        "fast-simplification": "fast_simplification",
        "manifold3d": "manifold3d",
        "meshio": "meshio",
        "scikit-image": "skimage",
    },
    "study": {"matplotlib": "matplotlib"} | {name: name for name in ["SALib", "xarray", "zarr", "pyarrow", "pandas"]},
    "feel": {"sounddevice": "sounddevice", "pynwb": "pynwb"},
    "afm": {"afmformats": "afmformats"},
    "cluster": {"distributed": "distributed", "cryptography": "cryptography"},
    "learn": {
        "scikit-learn": "sklearn",
        "scikit-image": "skimage",
        "nibabel": "nibabel",
    },
    "bench": {"felupe": "felupe", "matplotlib": "matplotlib", "mujoco": "mujoco"},
}
"""Extra -> package on the index -> name under which it is imported."""


def extra_of(module: str) -> str | None:
    """The extra that installs a module; None if no extra does."""
    top = module.partition(".")[0]
    return next((extra for extra, packages in EXTRAS.items() if top in packages.values()), None)


def missing(what: str, module: str | None, extra: str) -> str:
    """The error line for a missing or broken package: what needs it, its name on the index, the command that installs
    it. Call it while the ImportError is handled, which shows whether the package is missing or broken.

    module  that could not be imported, from `ImportError.name`
    """
    error = sys.exception()
    if isinstance(error, ImportError) and not isinstance(error, ModuleNotFoundError):
        return f"{what}: a package of palpate[{extra}] is installed but cannot be imported: {error}; {install(extra)}"
    top = (module or "").partition(".")[0]
    names = {top: package for packages in EXTRAS.values() for package, top in packages.items()}
    return f"{what}: the package {names.get(top, top or extra)} is not installed; {install(extra)}"


@contextmanager
def require_extra(what: str, extra: str, kind: type[Exception]) -> Iterator[None]:
    """Imports of optional packages. An ImportError becomes an error of this kind with the line of `missing`."""
    try:
        yield
    except ImportError as error:
        raise kind(missing(what, error.name, extra)) from None


def install(extra: str) -> str:
    """The command that installs an extra, for the tool that installed palpate."""
    wanted, prefix = f'"palpate[{extra}]"', Path(sys.prefix)
    if (prefix / "pipx_metadata.json").exists():
        kept = prefix.parent.name == "venvs"  # `pipx run` has its environments elsewhere
        return f"pipx runpip palpate install {wanted}" if kept else f"pipx run --spec {wanted} palpate ..."
    if (prefix / "uv-receipt.toml").exists():
        return f"uv tool install {wanted}"
    if prefix.parent.name.startswith("archive-v"):  # the cache of uv
        return f"uvx --from {wanted} palpate ..."
    return f"{'uv ' if find_spec('pip') is None else ''}pip install {wanted}"


def package_version(package: str) -> str | None:
    """Version of an installed package; None if it is not installed."""
    from importlib.metadata import PackageNotFoundError, version  # slow to import

    try:
        return version(package)
    except PackageNotFoundError:
        return None
