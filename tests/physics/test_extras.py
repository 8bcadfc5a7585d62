"""src/palpate/physics/extras.py: the suggested command fits the tool that installed palpate."""

import sys

import pytest

from palpate.physics.extras import extra_of, install, missing


@pytest.mark.parametrize(
    ("folder", "file", "command"),
    [
        ("pipx/venvs/palpate", "pipx_metadata.json", 'pipx runpip palpate install "palpate[view]"'),
        ("cache/pipx/1a2b", "pipx_metadata.json", 'pipx run --spec "palpate[view]" palpate ...'),
        ("uv/tools/palpate", "uv-receipt.toml", 'uv tool install "palpate[view]"'),
        ("uv/archive-v0/lPY7", "pyvenv.cfg", 'uvx --from "palpate[view]" palpate ...'),
        ("env", "pyvenv.cfg", 'pip install "palpate[view]"'),
    ],
)
def test_the_command_fits_the_tool_that_created_the_environment(tmp_path, monkeypatch, folder, file, command):
    prefix = tmp_path / folder
    prefix.mkdir(parents=True)
    (prefix / file).touch()
    monkeypatch.setattr(sys, "prefix", str(prefix))
    assert install("view") == command


def test_an_environment_without_pip_belongs_to_uv(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.setattr("palpate.physics.extras.find_spec", lambda name: None)
    assert install("view") == 'uv pip install "palpate[view]"'


def test_a_package_has_its_name_on_the_index():
    assert missing("images", "skimage.filters", "scan").startswith("images: the package scikit-image is not installed;")
    assert missing("a device", "usb.core", "devices").startswith("a device: the package pyusb is not installed;")
    assert extra_of("skimage.filters") == "scan" and extra_of("numpy") is None


def test_a_broken_package_is_not_reported_as_missing():
    try:
        raise ImportError("cannot import name 'x' from 'scipy'", name="scipy")
    except ImportError as error:
        reported = missing("FElupe", error.name, "bench")
    assert (
        "cannot import name 'x' from 'scipy'" in reported
        and "not installed" not in reported
        and "palpate[bench]" in reported
    )
