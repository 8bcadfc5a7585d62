// A client of palpate's frames (docs/renderers.md): plain .NET, for Unity or any other program.
//
// In Unity: put this file into Assets, call Listen(address) in Start() and move the mesh by Newest in Update():
//     for (int i = 0; i < frame.Moved.Length; i++) vertices[frame.Moved[i]] = rest[frame.Moved[i]] + Unity(frame.By[i]);
// palpate's world is right-handed with z up; Unity's is left-handed with y up: Unity(x, y, z) = new Vector3(x, z, y), and
// swap two corners of each triangle. On the console: mcs -define:CONSOLE PalpateClient.cs && mono PalpateClient.exe ADDRESS 100
using System;
using System.IO;
using System.Net.WebSockets;
using System.Text;
using System.Threading;
using System.Threading.Tasks;

namespace Palpate
{
    public struct Vector { public float X, Y, Z; }

    [Flags]
    public enum State : uint { None = 0, Touches = 1, Tip = 2, Force = 4, Friction = 8, Sticks = 16 }

    /// One finger: places [m], unit normal, force on the hand [N], normal force [N], depths [m].
    public struct Finger
    {
        public Vector Tip, Foot, Normal, Force;
        public float NormalForce, Indentation, Compression;
        public State State;
    }

    /// The undeformed surface: vertices [m] and the corners of each triangle.
    public sealed class Mesh
    {
        public int Fingers;
        public float Thickness;
        public Vector[] Vertices;
        public int[] Triangles;
    }

    /// One moment: the fingers, which vertices are moved and by how much [m]; all others are at rest.
    public sealed class Frame
    {
        public double Time;
        public uint Late;
        public Finger[] Fingers;
        public int[] Moved;
        public Vector[] By;
    }

    public sealed class Client : IDisposable
    {
        readonly ClientWebSocket socket = new ClientWebSocket();
        readonly CancellationTokenSource over = new CancellationTokenSource();
        volatile Mesh mesh;
        volatile Frame frame;

        /// The newest ones; null before the first. A new mesh is a new object.
        public Mesh Surface { get { return mesh; } }
        public Frame Newest { get { return frame; } }

        /// Open http://127.0.0.1:PORT/?token=TOKEN, as `palpate touch` prints it, and listen until Dispose.
        public async Task Listen(string address, Action<Frame> onFrame = null)
        {
            var page = new Uri(address);
            await socket.ConnectAsync(new Uri("ws://" + page.Authority + "/frames" + page.Query), over.Token);
            var bytes = new byte[1 << 16];
            while (socket.State == WebSocketState.Open)
            {
                var message = new MemoryStream();
                WebSocketReceiveResult part;
                do
                {
                    part = await socket.ReceiveAsync(new ArraySegment<byte>(bytes), over.Token);
                    message.Write(bytes, 0, part.Count);
                } while (!part.EndOfMessage);
                if (part.MessageType != WebSocketMessageType.Binary) continue; // JSON: what the run says, refusals
                message.Position = 0;
                Read(new BinaryReader(message)); // little-endian everywhere
                if (frame != null && onFrame != null) onFrame(frame);
            }
        }

        /// Ask the simulated hand to go to a place [m]; numbers rise by one from call to call.
        public Task Point(uint number, Vector to, int finger = 0)
        {
            var order = FormattableString.Invariant(
                $"{{\"point\": [{number}, [{to.X:R}, {to.Y:R}, {to.Z:R}], 0], \"finger\": {finger}}}");
            var text = new ArraySegment<byte>(Encoding.UTF8.GetBytes(order));
            return socket.SendAsync(text, WebSocketMessageType.Text, true, over.Token);
        }

        public void Dispose() { over.Cancel(); socket.Dispose(); }

        void Read(BinaryReader from)
        {
            var magic = Encoding.ASCII.GetString(from.ReadBytes(4));
            var version = from.ReadUInt16();
            if (version != 1) throw new InvalidDataException("found version " + version + " of the format, expected 1");
            int fingers = from.ReadUInt16(), count = (int)from.ReadUInt32();
            if (magic == "PLPM")
            {
                var surface = new Mesh { Fingers = fingers, Vertices = new Vector[count] };
                surface.Triangles = new int[3 * from.ReadUInt32()];
                (surface.Thickness, _) = (from.ReadSingle(), from.ReadUInt32()); // the second is reserved
                for (var i = 0; i < count; i++) surface.Vertices[i] = ReadVector(from);
                for (var i = 0; i < surface.Triangles.Length; i++) surface.Triangles[i] = (int)from.ReadUInt32();
                mesh = surface;
                return;
            }
            if (magic != "PLPF") throw new InvalidDataException("found '" + magic + "', expected PLPM or PLPF");
            var received = new Frame { Late = from.ReadUInt32(), Time = from.ReadDouble() };
            received.Fingers = new Finger[fingers];
            received.Moved = new int[count];
            received.By = new Vector[count];
            for (var i = 0; i < fingers; i++)
                received.Fingers[i] = new Finger
                {
                    Tip = ReadVector(from), Foot = ReadVector(from), Normal = ReadVector(from), Force = ReadVector(from),
                    NormalForce = from.ReadSingle(), Indentation = from.ReadSingle(), Compression = from.ReadSingle(),
                    State = (State)from.ReadUInt32(),
                };
            for (var i = 0; i < count; i++) received.Moved[i] = (int)from.ReadUInt32();
            for (var i = 0; i < count; i++) received.By[i] = ReadVector(from);
            frame = received;
        }

        static Vector ReadVector(BinaryReader r) => new Vector { X = r.ReadSingle(), Y = r.ReadSingle(), Z = r.ReadSingle() };
    }

#if CONSOLE
    static class Program
    {
        static void Main(string[] given)
        {
            int left = int.Parse(given[1]);
            using (var client = new Client())
            {
                var enough = new ManualResetEventSlim();
                Action<Frame> show = frame =>
                {
                    var f = frame.Fingers[0];
                    Console.WriteLine(FormattableString.Invariant(
                        $"{frame.Time:R} {client.Surface.Vertices.Length} {frame.Moved.Length} {f.NormalForce:R} {f.Foot.Z:R} {(uint)f.State}"));
                    if (--left <= 0) enough.Set();
                };
                var listening = client.Listen(given[0], show);
                while (!enough.Wait(100)) if (listening.IsCompleted) listening.GetAwaiter().GetResult();
            }
        }
    }
#endif
}
