"""The library of `palpate build web` in a real Firefox: recordings of it are replayed bit for bit.

By the library and not the page, which needs WebGL 2: Firefox has none on a machine without a graphics driver.
"""

import base64
import json

import pytest
from firefox import NEEDED, opened
from three_js import served
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.web.folder import build
from palpate.web.variants import Place

pytestmark = [*NEEDED, pytest.mark.timeout(900)]
BODIES = ("MassSpring", "Rigid")
PAGE = """<!doctype html><meta charset="utf-8"><script type="module">
import { load } from "./site/palpate.mjs";
async function press(body) {
  const touch = await load("site", { body }), { begin } = touch.about.pointers[0];
  const down = [begin[0], begin[1], begin[2] - 0.03];
  let most = 0;
  for (let k = 0; k < 1500; k++) {
    if (k % 20 === 0) touch.point(k < 200 || k > 1300 ? begin : down);
    if (!touch.step()) throw new Error(JSON.stringify(touch.failed));
    most = Math.max(most, touch.contact().load);
  }
  const bytes = new Uint8Array(await touch.recording().arrayBuffer());
  let text = "";
  for (const byte of bytes) text += String.fromCharCode(byte);
  return { most, recording: btoa(text) };
}
try {
  const found = {};
  for (const body of BODIES) found[body] = await press(body);
  window.palpate = { found };
} catch (error) { window.palpate = { failed: String(error) }; }
</script>"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What each body did in Firefox: its largest contact force, and its recording."""
    folder = tmp_path_factory.mktemp("web")
    build([Place(find("kidney"))], folder / "site", BODIES, lambda stage: lambda share: None)
    (folder / "press.html").write_text(PAGE.replace("BODIES", json.dumps(BODIES)), encoding="utf-8")
    with served(folder) as address, opened(f"{address}/press.html", "palpate", folder) as page:
        assert page.about["browserName"] == "firefox"
        assert page.evaluate("palpate.failed || null") is None
        return json.loads(page.evaluate("JSON.stringify(palpate.found)"))


@pytest.mark.parametrize("body", BODIES)
def test_a_recording_of_firefox_is_replayed_bit_for_bit(body, found, tmp_path):
    assert found[body]["most"] > 0.2
    (tmp_path / "firefox.mcap").write_bytes(base64.b64decode(found[body]["recording"]))
    done = CliRunner().invoke(app, ["replay", str(tmp_path / "firefox.mcap"), "--check", "--json"])
    printed = json.loads(done.stdout)
    assert done.exit_code == 0 and printed["ok"] and all(node["checked"] for node in printed["nodes"].values()), (
        done.output
    )
