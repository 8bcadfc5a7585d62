"""Files of keys: who may have written or read them, what they contain, and how they are made."""

import json
import os
import random
import stat

import pytest
import zmq
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.run.wire import keys
from palpate.physics.errors import RunError

NOBODY = 65534


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "a" / "config"))
    return tmp_path / "a" / "config"


def refused(name="rig"):
    with pytest.raises(RunError) as error:
        keys.load(name)
    text = str(error.value)
    assert "Traceback" not in text and "\n" not in text
    return text


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o022, 0o077])
def test_a_key_is_made_for_this_user_only_with_any_umask(home, umask):
    before = os.umask(umask)
    try:
        path = keys.make()
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    for place in (path.parent, path.parent.parent, home, home.parent):
        assert not stat.S_IMODE(place.stat().st_mode) & 0o077, place
    assert keys.load() == keys.load("rig")


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o757, 0o1777])
@pytest.mark.parametrize("above", [False, True])
def test_a_folder_that_others_can_write_is_refused(home, mode, above):
    """They could exchange keys in it."""
    path = keys.make()
    place = path.parent.parent if above else path.parent
    place.chmod(mode)
    assert f"the folder {place}: other users may write to it (mode {mode:o}; chmod go-w)" in refused()
    with pytest.raises(RunError, match="other users may write to it"):
        keys.make("another")
    place.chmod(0o755)
    assert keys.load().secret


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o602, 0o644, 0o666, 0o601])
def test_a_file_that_others_can_read_or_write_is_refused(home, mode):
    path = keys.make()
    path.chmod(mode)
    assert f"others can read or write it (mode {mode:o}); chmod 600 {path}" in refused()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make files of another user")
@pytest.mark.parametrize("what", ["file", "link", "hard link", "folder", "folder above", "linked folder"])
def test_files_and_folders_of_another_user_are_refused(home, what, tmp_path):
    path = keys.make()
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "rig.json").write_bytes(path.read_bytes())
    (theirs / "rig.json").chmod(0o600)
    match what:
        case "file":
            os.chown(path, NOBODY, NOBODY)
        case "link" | "hard link":
            path.unlink()
            os.chown(theirs / "rig.json", NOBODY, NOBODY)
            (path.symlink_to if what == "link" else path.hardlink_to)(theirs / "rig.json")
        case "linked folder":
            path.unlink()
            path.parent.rmdir()
            os.chown(theirs, NOBODY, NOBODY)
            path.parent.symlink_to(theirs)
        case _:
            os.chown(path.parent if what == "folder" else path.parent.parent, NOBODY, NOBODY)
    assert f"belongs to user {NOBODY}, expected" in refused()


def test_a_link_to_a_file_of_this_user_is_read(home, tmp_path):
    path = keys.make()
    path.rename(tmp_path / "kept.json")
    path.symlink_to(tmp_path / "kept.json")
    assert len(keys.load().public) == 40


def damaged():
    """A name, and the text of a file that is no key."""
    public, secret = (half.decode() for half in zmq.curve_keypair())
    other = zmq.curve_keypair()[0].decode()
    yield "another pair", json.dumps({"public": other, "secret": secret}), "does not belong to its secret part"
    yield "exchanged", json.dumps({"public": secret, "secret": public}), "does not belong to its secret part"
    for what in ("public", "secret"):
        pair = {"public": public, "secret": secret}
        for text in ("", public[:-1], public + "0", "~" * 40, "#####" * 8, "é" * 40, " " * 40, 3, None, True, [], {}):
            yield f"{what} {str(text)[:5]}", json.dumps(pair | {what: text}), "expected 40 characters of Z85"
        yield f"no {what}", json.dumps({k: v for k, v in pair.items() if k != what}), "expected the texts"
    for text in ("", "{}", "[]", "3", "null", "{", "\0", "[" * 3000, '"' + "x" * 100):
        yield text[:5], text, "expected the texts"
    yield "long", " " * 5000 + json.dumps({"public": public, "secret": secret}), "more than 4096 bytes"


def test_a_key_that_is_no_pair_is_refused_when_it_is_read(home):
    path, cases = keys.make(), list(damaged())
    assert len(cases) == 38
    for name, text, reason in cases:
        path.write_text(text)
        assert reason in refused(), name


def test_random_changes_of_a_key_file_never_load_another_key(home):
    path = keys.make()
    good, text = keys.load(), path.read_bytes()
    rng, loaded = random.Random(12), 0
    for _ in range(500):
        data = bytearray(text)
        for _ in range(rng.randint(1, 3)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(data)
        try:
            # The changed bytes were white space, or five bits of the secret part that do not count (RFC 7748, 5).
            assert keys.load().public == good.public
            loaded += 1
        except RunError as error:
            assert "\n" not in str(error) and ("damaged" in str(error))
    assert loaded < 50


@pytest.mark.parametrize("name", ["a" * 101, "a" * 300, "../rig", ".rig", "a/b", "", "a b", "rig\n", "é", "a\0"])
def test_a_name_that_is_no_file_is_refused(home, name):
    for call in (keys.load, keys.make):
        with pytest.raises(RunError, match=r"expected a name of at most 100 letters"):
            call(name)
    result = CliRunner().invoke(app, ["remote", "keys", name, "--make"])
    assert result.exit_code == 1 and result.exception.__class__ is SystemExit
    assert not list(home.rglob("*.json"))


def test_a_fifo_is_no_key(home):
    path = keys.make()
    path.unlink()
    os.mkfifo(path, 0o600)
    assert "it is no file" in refused()


def test_the_secret_is_not_printed():
    key = keys.Key.make()
    assert key.secret not in repr(key) and key.public in repr(key)
