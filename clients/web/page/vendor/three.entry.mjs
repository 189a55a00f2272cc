export {
    BufferAttribute, BufferGeometry, Color, ConeGeometry, CylinderGeometry, DataTexture, DoubleSide, GridHelper, Group,
    LinearMipmapNearestFilter, Matrix4, Mesh, PerspectiveCamera, Quaternion, RepeatWrapping, Scene, ShaderMaterial,
    Texture, Vector2, Vector3, WebGLRenderer,
} from 'three';
