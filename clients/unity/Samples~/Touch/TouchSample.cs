using Palpate;
using UnityEngine;

/// <summary>
/// A body, a camera before it, and a ball that the mouse leads: move it across, the wheel lowers and lifts it. A line shows the
/// force. Start `palpate serve --scene cube` on this machine before.
/// </summary>
public sealed class TouchSample : MonoBehaviour
{
    [Tooltip("Metres that a newton is long.")]
    public float metresPerNewton = 0.02f;

    TouchTool hand;
    LineRenderer arrow;
    float height = 0.16f;

    void Start()
    {
        var body = new GameObject("Body", typeof(MeshFilter), typeof(MeshRenderer), typeof(BodySurface));
        body.GetComponent<MeshRenderer>().material.color = new Color(0.78f, 0.42f, 0.38f);

        GameObject ball = GameObject.CreatePrimitive(PrimitiveType.Sphere);
        ball.transform.localScale = Vector3.one * 0.04f;
        hand = ball.AddComponent<TouchTool>();
        hand.body = body.transform;
        arrow = ball.AddComponent<LineRenderer>();
        arrow.positionCount = 2;
        arrow.widthMultiplier = 0.004f;

        Camera eye = new GameObject("Camera", typeof(Camera)).GetComponent<Camera>();
        eye.nearClipPlane = 0.01f;
        eye.transform.position = new Vector3(0.05f, 0.22f, -0.25f);
        eye.transform.LookAt(new Vector3(0.05f, 0.06f, 0.05f));
        new GameObject("Light", typeof(Light)).GetComponent<Light>().type = LightType.Directional;
    }

    void Update()
    {
        height -= 0.005f * Input.mouseScrollDelta.y;
        float across = Input.mousePosition.x / Screen.width, along = Input.mousePosition.y / Screen.height;
        hand.transform.position = new Vector3(0.1f * across, height, 0.1f * along);
        arrow.SetPosition(0, hand.transform.position);
        arrow.SetPosition(1, hand.transform.position + metresPerNewton * hand.Force);
    }
}
