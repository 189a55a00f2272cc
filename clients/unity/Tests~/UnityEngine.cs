// What the components use of Unity, so that they compile where there is no Unity. Nothing here does anything.
using System;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public static Vector3 zero, one;
        public static Vector3 operator +(Vector3 a, Vector3 b) { return a; }
        public static Vector3 operator -(Vector3 a, Vector3 b) { return a; }
        public static Vector3 operator *(Vector3 a, float b) { return a; }
        public static Vector3 operator *(float a, Vector3 b) { return b; }
        public static Vector3 operator /(Vector3 a, float b) { return a; }
    }
    public struct Vector2 { public float x, y; }
    public struct Quaternion
    {
        public float x, y, z, w;
        public static Quaternion Inverse(Quaternion q) { return q; }
        public static Quaternion operator *(Quaternion a, Quaternion b) { return a; }
    }
    public struct Color { public Color(float r, float g, float b) { } }
    public class Object { public static void Destroy(Object what) { } }
    public class Component : Object
    {
        public Transform transform { get { return null; } }
        public T GetComponent<T>() { return default(T); }
    }
    public class Behaviour : Component { }
    public class MonoBehaviour : Behaviour { }
    public class Transform : Component
    {
        public Vector3 position { get; set; }
        public Vector3 localScale { get; set; }
        public Quaternion rotation { get; set; }
        public Vector3 InverseTransformPoint(Vector3 point) { return point; }
        public Vector3 TransformDirection(Vector3 direction) { return direction; }
        public void LookAt(Vector3 point) { }
    }
    public class GameObject : Object
    {
        public GameObject(string name, params Type[] components) { }
        public Transform transform { get { return null; } }
        public T GetComponent<T>() { return default(T); }
        public T AddComponent<T>() where T : Component { return default(T); }
        public static GameObject CreatePrimitive(PrimitiveType type) { return null; }
    }
    public enum PrimitiveType { Sphere }
    public enum LightType { Directional }
    public class Light : Behaviour { public LightType type { get; set; } }
    public class Camera : Behaviour { public float nearClipPlane { get; set; } }
    public class Renderer : Component { public Material material { get; set; } }
    public class MeshRenderer : Renderer { }
    public class LineRenderer : Renderer
    {
        public int positionCount { get; set; }
        public float widthMultiplier { get; set; }
        public void SetPosition(int at, Vector3 position) { }
    }
    public class Material : Object { public Color color { get; set; } }
    public class MeshFilter : Component { public Mesh mesh { get; set; } }
    public class Mesh : Object
    {
        public Rendering.IndexFormat indexFormat { get; set; }
        public Vector3[] vertices { get; set; }
        public Vector3[] normals { get; set; }
        public int[] triangles { get; set; }
        public void Clear() { }
        public void MarkDynamic() { }
        public void RecalculateBounds() { }
    }
    public static class Time { public static float deltaTime { get { return 0; } } }
    public static class Debug { public static void LogWarning(object message) { } }
    public static class Input
    {
        public static Vector2 mouseScrollDelta { get { return default(Vector2); } }
        public static Vector3 mousePosition { get { return default(Vector3); } }
    }
    public static class Screen
    {
        public static int width { get { return 1; } }
        public static int height { get { return 1; } }
    }
    public class AddComponentMenu : Attribute { public AddComponentMenu(string menu) { } }
    [AttributeUsage(AttributeTargets.Field)]
    public class TooltipAttribute : Attribute { public TooltipAttribute(string words) { } }
    public class RequireComponent : Attribute { public RequireComponent(Type a, Type b) { } }
}

namespace UnityEngine.Rendering
{
    public enum IndexFormat { UInt16, UInt32 }
}
