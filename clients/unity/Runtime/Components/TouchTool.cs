using UnityEngine;

namespace Palpate
{
    /// <summary>
    /// Leads a tool of a Palpate server with this object, as a controller or a mouse moves it, and says the force on it. Its
    /// place in the body is that relative to <c>body</c>.
    /// </summary>
    [AddComponentMenu("Palpate/Touch Tool")]
    public sealed class TouchTool : MonoBehaviour
    {
        [Tooltip("Where the body lies; the scene's origin without it.")]
        public Transform body;
        [Tooltip("Name of the tool; any free one without it.")]
        public string tool = "";
        [Tooltip("Whose limits the force keeps.")]
        public string device = "PHANTOM Omni";
        [Tooltip("Pictures a second: poses go out with each.")]
        public double rateHz = 90;
        public string forceEndpoint = "", surfaceEndpoint = "", session = "";
        [Tooltip("Folder of your certificate, where the server asks for one.")]
        public string identity = "";

        /// <summary>On the tool, in the axes of the scene [N]: what to draw, or to make vibrations from.</summary>
        public Vector3 Force { get; private set; }

        /// <summary>How the tool is doing; Gone without one.</summary>
        public ToolState State { get; private set; }

        Background<HapticTool> hand;
        Vector3 before;

        void OnEnable()
        {
            var server = new HapticTool.Server
            {
                ForceEndpoint = forceEndpoint, SurfaceEndpoint = surfaceEndpoint, Session = session,
                Identity = identity
            };
            string name = tool, limits = device;
            double rate = rateHz;
            hand = new Background<HapticTool>(
                () => new HapticTool(server, name, rate, limits), reason => Debug.LogWarning("Palpate: " + reason));
            before = Place();
        }

        void OnDisable()
        {
            hand.End();
            Force = Vector3.zero;
        }

        Vector3 Place()
        {
            return body == null ? transform.position : body.InverseTransformPoint(transform.position);
        }

        void Update()
        {
            Vector3 place = Place();
            Vector3 velocity = Time.deltaTime > 0 ? (place - before) / Time.deltaTime : Vector3.zero;
            before = place;
            HapticTool held = hand.Value;
            Force = Vector3.zero;
            if (held == null)
            {
                State = new ToolState { Hold = Hold.Gone };
                return;
            }
            Quaternion turn = body == null ? transform.rotation : Quaternion.Inverse(body.rotation) * transform.rotation;
            try
            {
                held.SendPose(Numbers(place), new Rotation(turn.x, turn.y, turn.z, turn.w));
                Vector torque, force = held.Force(Numbers(place), Numbers(velocity), out torque);
                Force = new Vector3((float)force.X, (float)force.Y, (float)force.Z);
                if (body != null)
                    Force = body.TransformDirection(Force);
                State = held.State;
            }
            catch (PalpateException e)
            {
                // The tool is gone: it is taken again.
                Debug.LogWarning("Palpate: " + e.Message);
                hand.Drop();
            }
        }

        static Vector Numbers(Vector3 v)
        {
            return new Vector(v.x, v.y, v.z);
        }
    }
}
