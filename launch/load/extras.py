"""Which optional packages belong to which extra of palpate's installation."""

EXTRAS = {
    "devices": {"pyusb": "usb", "hidapi": "hid", "pyserial": "serial", "websockets": "websockets"},
    "page": {"websockets": "websockets"},
    "fmu": {"pythonfmu3": "pythonfmu3"},
    "gym": {"gymnasium": "gymnasium"},
    "view": {"matplotlib": "matplotlib", "pyvista": "pyvista"},
    "scan": {"scikit-image": "skimage", "pydicom": "pydicom", "nibabel": "nibabel", "matplotlib": "matplotlib"},
    "export": {"pyarrow": "pyarrow"},
    "table": {"pandas": "pandas"},
    "rerun": {"rerun-sdk": "rerun"},
    "lsl": {"pylsl": "pylsl"},
    "film": {"pyvista": "pyvista", "matplotlib": "matplotlib", "imageio-ffmpeg": "imageio_ffmpeg", "pillow": "PIL"},
    "mesh": {"meshio": "meshio", "trimesh": "trimesh"},
    "study": {
        "distributed": "distributed",
        "dask-jobqueue": "dask_jobqueue",
        "bokeh": "bokeh",
        "SALib": "SALib",
        "xarray": "xarray",
        "zarr": "zarr",
        "pyarrow": "pyarrow",
        "pandas": "pandas",
        "matplotlib": "matplotlib",
    },
    "bench": {"felupe": "felupe", "matplotlib": "matplotlib", "mujoco": "mujoco"},
}
"""Extra -> package on the index -> name under which it is imported."""


def extra_of(module: str) -> str | None:
    """The extra that brings a module, None where no extra does."""
    top = module.partition(".")[0]
    return next((extra for extra, packages in EXTRAS.items() if top in packages.values()), None)


def install(extra: str) -> str:
    """What to type for an extra."""
    return f'pip install "palpate[{extra}]"'
