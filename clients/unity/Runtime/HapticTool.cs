using System;

namespace Palpate
{
    /// <summary>
    /// A tool of a server in the hand. Poses and forces are in the axes of a frame, Unity's by default: metres, and newtons
    /// on the hand. May be used by any thread, but by one at a time.
    /// </summary>
    public sealed class HapticTool : IDisposable
    {
        IntPtr client;

        /// <summary>Where the server is; empty: that of a server on this machine.</summary>
        public struct Server
        {
            public string ForceEndpoint, SurfaceEndpoint, Session;

            /// <summary>Folder of this client's certificate, where the server asks for one.</summary>
            public string Identity;
        }

        /// <summary>Connects and takes a tool, by name or any free one; waits for the network, up to 5 s an endpoint.</summary>
        /// <param name="rateHz">How often poses will be sent: 72 to 90 for a headset, 1000 for a haptic device.</param>
        /// <param name="device">Whose limits the force keeps: a name, or a TOML file.</param>
        /// <param name="frame">"unity", "palpate", "openxr", "phantom" …</param>
        public HapticTool(Server server = default(Server), string tool = "", double rateHz = 90,
            string device = "PHANTOM Omni", string frame = "unity", string name = "Unity")
        {
            using (var texts = new Texts())
            {
                client = Native.palpate_connect(
                    texts.Add(server.ForceEndpoint), texts.Add(server.SurfaceEndpoint), texts.Add(server.Session),
                    texts.Add(server.Identity));
                Native.Check(client != IntPtr.Zero);
                Native.Attachment attachment;
                Native.palpate_attachment_defaults(out attachment);
                attachment.Client = texts.Add(name);
                attachment.Tool = texts.Add(tool);
                attachment.RateHz = rateHz;
                attachment.Device = texts.Add(device);
                attachment.Frame = texts.Add(frame);
                try
                {
                    Native.Check(Native.palpate_attach(client, ref attachment) == 0);
                }
                catch
                {
                    Dispose();
                    throw;
                }
            }
        }

        /// <summary>Version of the library.</summary>
        public static string Version => Native.Text(Native.palpate_version());

        /// <summary>Sends a pose; does not wait for the network. Throws while the tool is gone, and sends it all the same.</summary>
        /// <param name="opening">How far the tool's jaws are to be open: 0, closed, to 1.</param>
        public void SendPose(Vector position, Rotation orientation, uint buttons = 0, float opening = 0)
        {
            var pose = new Native.Pose { Position = position, Orientation = orientation, Buttons = buttons, Opening = opening };
            Native.Check(Native.palpate_send_pose(client, ref pose) == 0);
        }

        /// <summary>
        /// The force [N] to give now for the position and velocity just read, and the torque [N m]: at the device's own rate.
        /// Throws while the tool is gone; there is no force then.
        /// </summary>
        public Vector Force(Vector position, Vector velocity, out Vector torque)
        {
            Vector force;
            Native.Check(Native.palpate_force(client, ref position, ref velocity, out force, out torque) == 0);
            return force;
        }

        /// <summary>How the tool is doing; that it is gone is an answer.</summary>
        public ToolState State
        {
            get
            {
                ToolState state;
                Native.Check(Native.palpate_state(client, out state) == 0);
                return state;
            }
        }

        /// <summary>The newest status of the server; false before the first, which comes a second after the first call.</summary>
        public bool Status(ref ServerStatus status)
        {
            int came = Native.palpate_status(client, ref status);
            Native.Check(came >= 0);
            return came == 1;
        }

        /// <summary>While it is pressed the tool stays where it is in the body, and the hand moves freely.</summary>
        public void Clutch(bool pressed)
        {
            Native.Check(Native.palpate_clutch(client, pressed ? 1 : 0) == 0);
        }

        /// <summary>Gives the tool back.</summary>
        public void Dispose()
        {
            Native.palpate_close(client);
            client = IntPtr.Zero;
        }
    }
}
