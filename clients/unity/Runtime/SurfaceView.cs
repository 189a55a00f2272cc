using System;
using System.Runtime.InteropServices;

namespace Palpate
{
    /// <summary>The surface of the body as it moves, in body space: right-handed, metres, +z up.</summary>
    public sealed class SurfaceView : IDisposable
    {
        IntPtr watch;
        Native.Surface surface;

        /// <summary>Starts to watch; waits for the network, up to 5 s.</summary>
        /// <param name="every">Every frame (1) of 31 a second, every second (2), fourth (4) or eighth (8).</param>
        /// <param name="identity">Folder of this client's certificate, where the server asks for one.</param>
        public SurfaceView(string surfaceEndpoint = "", string session = "", uint every = 1, string identity = "")
        {
            using (var texts = new Texts())
                watch = Native.palpate_watch_open(
                    texts.Add(surfaceEndpoint), texts.Add(session), texts.Add(identity), every, 0);
            Native.Check(watch != IntPtr.Zero);
        }

        /// <summary>Three numbers [m] for each vertex.</summary>
        public float[] Positions { get; private set; } = new float[0];

        /// <summary>Three numbers for each vertex: unit, out of the body.</summary>
        public float[] Normals { get; private set; } = new float[0];

        /// <summary>Three vertex numbers for each triangle, counter-clockwise seen from outside.</summary>
        public int[] Indices { get; private set; } = new int[0];

        /// <summary>Another number: other triangles.</summary>
        public uint Topology => surface.Topology;

        /// <summary>Simulated time [ms].</summary>
        public ulong Tick => surface.Tick;

        /// <summary>Takes the newest frame; false where none has come since the last call. Does not wait.</summary>
        public bool Update()
        {
            uint before = surface.Topology;
            int newer = Native.palpate_watch_latest(watch, ref surface);
            Native.Check(newer >= 0);
            if (newer == 0)
                return false;
            int numbers = 3 * (int)surface.Vertices, corners = 3 * (int)surface.Triangles;
            if (Positions.Length != numbers)
            {
                Positions = new float[numbers];
                Normals = new float[numbers];
            }
            Marshal.Copy(surface.Positions, Positions, 0, numbers);
            Marshal.Copy(surface.Normals, Normals, 0, numbers);
            if (Indices.Length != corners || before != surface.Topology)
            {
                Indices = new int[corners];
                Marshal.Copy(surface.Indices, Indices, 0, corners);
            }
            return true;
        }

        public void Dispose()
        {
            Native.palpate_watch_close(watch);
            watch = IntPtr.Zero;
        }
    }
}
