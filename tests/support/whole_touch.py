"""A whole touch of the small nodes in graph_nodes.py: device, finger, contact, friction, tissue, controller, log."""

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
