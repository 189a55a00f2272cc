export {
    AmbientLight, BufferAttribute, BufferGeometry, Color, ConeGeometry, CylinderGeometry, DirectionalLight, GridHelper,
    Group, Matrix4, Mesh, MeshBasicMaterial, MeshPhongMaterial, PerspectiveCamera, Quaternion, Scene, Vector2,
    Vector3, WebGLRenderer,
} from 'three';
