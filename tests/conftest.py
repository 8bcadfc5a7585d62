"""What several tests of the launcher share: graphs written for one test, of the small nodes in graph_nodes.py."""

import signal
import textwrap

import pytest

# Whoever starts the tests in the background may have them, and all that they start, ignore these signals: Ctrl-C would
# reach nobody.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

WHOLE = """
scene:
  tissue: {friction: true, stiffness: 0.4 kN/m, cells: 12}
  finger: {radius: 6 mm, h0: 3e-3}
nodes:
  device:   {use: graph_nodes.Hand, in: {torque: motor}}
  finger:   {use: graph_nodes.Finger, in: {state: device}, with: $finger}
  near:     {use: graph_nodes.Near, in: {pose: finger}}
  contact:  {use: graph_nodes.Press, in: {proximity: near, body: tissue}}
  friction: {use: graph_nodes.Rub, in: {contact: contact}, when: tissue.friction}
  spread:   {use: graph_nodes.Spread, in: {contact: contact, friction: friction}}
  tissue:   {use: graph_nodes.Spring, in: {load: spread}, with: $tissue}
  control:  {use: graph_nodes.Control, in: {contact: contact, friction: friction}}
  motor:    {use: graph_nodes.Motor, in: {force: control}}
  log:      {use: graph_nodes.Tape, in: all}
"""


@pytest.fixture
def write(tmp_path):
    """Writes a file below the test's folder and gives its path."""

    def put(name, text):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(textwrap.dedent(text), encoding="utf-8")
        return file

    return put


@pytest.fixture
def whole(write):
    """A whole touch: device, finger, contact, friction, tissue, controller, log."""
    return write("whole.yaml", WHOLE)
