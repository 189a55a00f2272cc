using UnityEngine;
using UnityEngine.Rendering;

namespace Palpate
{
    /// <summary>Shows the body of a Palpate server as it moves, in the mesh of this object.</summary>
    [AddComponentMenu("Palpate/Body Surface")]
    [RequireComponent(typeof(MeshFilter), typeof(MeshRenderer))]
    public sealed class BodySurface : MonoBehaviour
    {
        public string surfaceEndpoint = "", session = "";
        [Tooltip("Folder of your certificate, where the server asks for one.")]
        public string identity = "";
        [Tooltip("Every frame (1) of 31 a second, every second (2), fourth (4) or eighth (8).")]
        public uint every = 1;

        Background<SurfaceView> view;
        Mesh mesh;
        uint topology;
        Vector3[] vertices, normals;

        void OnEnable()
        {
            string endpoint = surfaceEndpoint, name = session, certificate = identity;
            uint frames = every;
            view = new Background<SurfaceView>(
                () => new SurfaceView(endpoint, name, frames, certificate), reason => Debug.LogWarning("Palpate: " + reason));
            mesh = new Mesh { indexFormat = IndexFormat.UInt32 };
            mesh.MarkDynamic();
            topology = 0;
            GetComponent<MeshFilter>().mesh = mesh;
        }

        void OnDisable()
        {
            view.End();
            Destroy(mesh);
        }

        void Update()
        {
            SurfaceView seen = view.Value;
            if (seen == null || !seen.Update())
                return;
            bool other = seen.Topology != topology;
            if (other)
            {
                mesh.Clear();
                vertices = new Vector3[seen.Positions.Length / 3];
                normals = new Vector3[vertices.Length];
            }
            for (int v = 0; v < vertices.Length; v++)
            {
                vertices[v] = InUnity(seen.Positions, v);
                normals[v] = InUnity(seen.Normals, v);
            }
            mesh.vertices = vertices;
            mesh.normals = normals;
            if (other)
            {
                // The mirror that turns our axes into Unity's turns the winding, too: both have their outside in front.
                mesh.triangles = seen.Indices;
                topology = seen.Topology;
            }
            mesh.RecalculateBounds();
        }

        /// <summary>Right, forward, up to right, up, forward.</summary>
        static Vector3 InUnity(float[] numbers, int at)
        {
            return new Vector3(numbers[3 * at], numbers[3 * at + 2], numbers[3 * at + 1]);
        }
    }
}
