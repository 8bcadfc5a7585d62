// The engine behind the page of `palpate touch`: a run in other processes, through the WebSocket of its server. A page without a
// server has another file of this name, whose engine runs in the page.

// told: takes texts of the engine as objects; came: takes meshes and frames (`feed.pack_message`); closed: the run has ended. takes: whether
// an order would be carried out now.
export function connect({ told, came, closed }) {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(`${scheme}://${location.host}/socket${location.search}`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => (typeof data === "string" ? told(JSON.parse(data)) : came(data));
  socket.onclose = closed;
  return { downloads: false, devices: false, takes: () => socket.readyState === WebSocket.OPEN, send: (what) => socket.send(JSON.stringify(what)) };
}
