using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Palpate
{
    /// <summary>Three numbers, laid out as C has them.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Vector
    {
        public double X, Y, Z;

        public Vector(double x, double y, double z)
        {
            X = x;
            Y = y;
            Z = z;
        }

        public double Length => Math.Sqrt(X * X + Y * Y + Z * Z);
    }

    /// <summary>A unit quaternion.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Rotation
    {
        public double X, Y, Z, W;

        public Rotation(double x, double y, double z, double w)
        {
            X = x;
            Y = y;
            Z = z;
            W = w;
        }

        public static readonly Rotation None = new Rotation(0, 0, 0, 1);
    }

    /// <summary>Whether the tool is still in the hand.</summary>
    public enum Hold
    {
        /// <summary>Wrenches come and answer the poses.</summary>
        Held = 0,
        /// <summary>Wrenches have stopped: the force fades, and is zero 70 ms after the last.</summary>
        Fading = 1,
        /// <summary>The server takes none of the poses since 0.2 s: they are outside the workspace.</summary>
        Refused = 2,
        /// <summary>No wrench for 1 s, or somebody else holds the tool: attach again.</summary>
        Gone = 3
    }

    /// <summary>Where a tool stands in its life: why there is no force.</summary>
    public enum Phase
    {
        /// <summary>No pose has come to the server, or they stopped for 100 ms.</summary>
        Detached = 0,
        /// <summary>The tool has to leave the body before it can touch it.</summary>
        Waiting = 1,
        /// <summary>Forces are rendered.</summary>
        Engaged = 2,
        /// <summary>Poses are late: the force fades.</summary>
        Holding = 3
    }

    /// <summary>How a tool is doing.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ToolState
    {
        public Hold Hold;
        public Phase Phase;
        /// <summary>Why the force differs from the physical one: bits of palpate_flag in palpate.h.</summary>
        public uint Flags;
        /// <summary>Contact points that carry force; 0: free.</summary>
        public uint ContactPoints;
        /// <summary>Age of the newest wrench [s].</summary>
        public double Age;
        /// <summary>Of the jaws of the simulated tool: 0, closed, to 1.</summary>
        public double Opening;
        /// <summary>What opens them, for the angle between them [N m].</summary>
        public double GripTorque;
    }

    /// <summary>How the server is doing; see palpate_server_status in palpate.h. Counts are since its start.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ServerStatus
    {
        public ulong Tick;
        public double TickRateHz, Age, Lateness, Compute;
        public ulong MissedDeadlines, LapsedTicks, UnmovedTicks, RestoredStates, Refused, Nodes, Elements, Clients;
    }

    /// <summary>Something that the library, or the server, could not do, in plain words.</summary>
    public sealed class PalpateException : Exception
    {
        public PalpateException(string message) : base(message)
        {
        }
    }

    /// <summary>palpate.h, as far as it is used here.</summary>
    static class Native
    {
        const string Library = "palpate_sdk";

        [StructLayout(LayoutKind.Sequential)]
        public struct Registration
        {
            public double Scale;
            public Rotation Rotation;
            public Vector Translation;
        }

        [StructLayout(LayoutKind.Sequential)]
        public struct Attachment
        {
            public IntPtr Client, Tool;
            public double RateHz;
            public IntPtr Device, Frame, Render;
            public Registration Registration;
        }

        [StructLayout(LayoutKind.Sequential)]
        public struct Pose
        {
            public Vector Position;
            public Rotation Orientation;
            public uint Buttons;
            public float Opening;
        }

        [StructLayout(LayoutKind.Sequential)]
        public struct Surface
        {
            public uint Topology;
            public ulong Tick, Sequence;
            public UIntPtr Vertices, Triangles, Tools;
            public IntPtr Positions, Normals, Indices, Levels, ShownTools;
        }

        [DllImport(Library)]
        public static extern IntPtr palpate_version();

        [DllImport(Library)]
        public static extern IntPtr palpate_last_error();

        [DllImport(Library)]
        public static extern IntPtr palpate_connect(
            IntPtr forceEndpoint, IntPtr surfaceEndpoint, IntPtr session, IntPtr identity);

        [DllImport(Library)]
        public static extern void palpate_attachment_defaults(out Attachment attachment);

        [DllImport(Library)]
        public static extern int palpate_attach(IntPtr client, ref Attachment attachment);

        [DllImport(Library)]
        public static extern int palpate_send_pose(IntPtr client, ref Pose pose);

        [DllImport(Library)]
        public static extern int palpate_force(
            IntPtr client, ref Vector position, ref Vector velocity, out Vector force, out Vector torque);

        [DllImport(Library)]
        public static extern int palpate_state(IntPtr client, out ToolState state);

        [DllImport(Library)]
        public static extern int palpate_status(IntPtr client, ref ServerStatus status);

        [DllImport(Library)]
        public static extern int palpate_clutch(IntPtr client, int pressed);

        [DllImport(Library)]
        public static extern void palpate_close(IntPtr client);

        [DllImport(Library)]
        public static extern IntPtr palpate_watch_open(
            IntPtr surfaceEndpoint, IntPtr session, IntPtr identity, uint every, int levels);

        [DllImport(Library)]
        public static extern int palpate_watch_latest(IntPtr watch, ref Surface surface);

        [DllImport(Library)]
        public static extern void palpate_watch_close(IntPtr watch);

        /// <summary>Throws what the last call of this thread says where it failed.</summary>
        public static void Check(bool good)
        {
            if (!good)
                throw new PalpateException(Text(palpate_last_error()));
        }

        public static string Text(IntPtr utf8)
        {
            int length = 0;
            while (Marshal.ReadByte(utf8, length) != 0)
                length++;
            var bytes = new byte[length];
            Marshal.Copy(utf8, bytes, 0, length);
            return Encoding.UTF8.GetString(bytes);
        }
    }

    /// <summary>Texts for C, freed together. Empty ones are NULL: the default.</summary>
    sealed class Texts : IDisposable
    {
        readonly System.Collections.Generic.List<IntPtr> all = new System.Collections.Generic.List<IntPtr>();

        public IntPtr Add(string text)
        {
            if (string.IsNullOrEmpty(text))
                return IntPtr.Zero;
            byte[] bytes = Encoding.UTF8.GetBytes(text + "\0");
            IntPtr copy = Marshal.AllocHGlobal(bytes.Length);
            Marshal.Copy(bytes, 0, copy, bytes.Length);
            all.Add(copy);
            return copy;
        }

        public void Dispose()
        {
            all.ForEach(Marshal.FreeHGlobal);
            all.Clear();
        }
    }
}
