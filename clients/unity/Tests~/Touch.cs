using System;
using System.Collections.Generic;
using System.Threading;
using Palpate;

/// <summary>Presses a server's body from above, in Unity's axes, and prints what is felt and seen.</summary>
static class Touch
{
    static int Main(string[] arguments)
    {
        var server = new HapticTool.Server
        {
            ForceEndpoint = arguments[0], SurfaceEndpoint = arguments[1], Session = arguments[2],
            Identity = arguments.Length > 6 ? arguments[6] : ""
        };
        // In Unity's axes: right, up, forward [m].
        double right = Number(arguments[3]), up = Number(arguments[4]), forward = Number(arguments[5]);
        try
        {
            using (var view = new SurfaceView(server.SurfaceEndpoint, server.Session, identity: server.Identity))
            using (var tool = new HapticTool(server, rateHz: 500, device: "Touch", name: "Touch.cs"))
            {
                var status = new ServerStatus();
                tool.Status(ref status);
                double most = 0, lowest = double.MaxValue;
                // While it is held still and engaged: a machine that is busy elsewhere for 20 ms silences the hand.
                var held = new List<double>();
                var state = tool.State;
                Vector force = new Vector(), torque;
                // From 25 mm above the place down to it in a second; then it is held.
                for (int step = 0; step < 1000; step++)
                {
                    double above = 0.025 * Math.Max(0, 1 - step / 500.0);
                    var position = new Vector(right, up + above, forward);
                    var velocity = new Vector(0, step < 500 ? -0.025 : 0, 0);
                    tool.SendPose(position, Rotation.None);
                    force = tool.Force(position, velocity, out torque);
                    most = Math.Max(most, force.Y);
                    if (step >= 750 && tool.State.Phase == Phase.Engaged)
                    {
                        held.Add(force.Y);
                        state = tool.State;
                    }
                    if (view.Update())
                        lowest = Math.Min(lowest, Under(view, right, forward));
                    Thread.Sleep(2);
                }
                Console.WriteLine("library {0}", HapticTool.Version);
                Console.WriteLine("{0} and {1}, {2} points", state.Hold, state.Phase, state.ContactPoints);
                Console.WriteLine("vertices {0}, triangles {1}", view.Positions.Length / 3, view.Indices.Length / 3);
                Console.WriteLine("clients {0}", tool.Status(ref status) ? status.Clients.ToString() : "unknown");
                Print("most", most);
                held.Sort();
                Print("held", held.Count > 0 ? held[held.Count / 2] : 0);
                Print("lowest", lowest);
            }
            // A tool that is not there is an error in plain words.
            new HapticTool(server, tool: "no such tool").Dispose();
        }
        catch (PalpateException e)
        {
            Console.WriteLine("refused: {0}", e.Message);
            return 0;
        }
        return 1;
    }

    /// <summary>Height [m] of the vertex that is nearest to the place, seen from above: x and y of the body.</summary>
    static double Under(SurfaceView view, double x, double y)
    {
        double nearest = double.MaxValue, height = 0;
        for (int v = 0; v < view.Positions.Length; v += 3)
        {
            double dx = view.Positions[v] - x, dy = view.Positions[v + 1] - y, away = dx * dx + dy * dy;
            // Of the upper side.
            if (view.Normals[v + 2] > 0.1 && away < nearest)
            {
                nearest = away;
                height = view.Positions[v + 2];
            }
        }
        return height;
    }

    static double Number(string text)
    {
        return double.Parse(text, System.Globalization.CultureInfo.InvariantCulture);
    }

    static void Print(string what, double number)
    {
        Console.WriteLine(what + " " + number.ToString("R", System.Globalization.CultureInfo.InvariantCulture));
    }
}
