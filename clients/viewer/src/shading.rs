//! How light falls on things: in one colour, from a picture, and behind everything.

use std::sync::Arc;
use three_d::{
    Cull, DepthTest, EffectMaterialId, InnerSpace, Light, Material, MaterialType, Program, RenderStates, Srgba,
    Texture2D, Vec3, Vec4, Viewer, WriteMask, vec3, vec4,
};

/// Smooth surfaces under a key light beside the eye and a dim sky, in the colours of their vertices.
///
/// Leaner than a physical material, and without powers: pictures are also drawn without a graphics card. Brightness is
/// the square of what the screen is told ([`linear`]).
pub struct Shaded {
    /// Multiplies the vertices' own colours.
    pub colour: Srgba,
    /// Strength of highlights, 0 to 1.
    pub gloss: f32,
    /// How far light reaches around into the shade, as it does in tissue, 0 to 1.
    pub wrap: f32,
    /// From behind it is not there: the ground hides nothing that lies on it.
    pub one_sided: bool,
}

/// As [`Shaded`], in a colour and the colours of a picture; the colours of the vertices cover them as far as their alpha says.
pub struct Painted {
    /// Linear: a factor on the picture.
    pub colour: Vec4,
    /// The picture, where there is one.
    pub picture: Option<Arc<Texture2D>>,
}

/// Light grey behind everything, a little lighter above.
pub struct Backdrop;

/// Each shader says the colour of the thing itself before these lines.
const LIT: &str = "
uniform vec3 eye;
uniform vec3 key;
uniform vec3 fill;
uniform float gloss;
uniform float wrap;
in vec3 pos;
in vec3 nor;
layout (location = 0) out vec4 result;

void main() {
    vec3 sight = normalize(eye - pos);
    vec3 normal = normalize(gl_FrontFacing ? nor : -nor);
    vec3 sky = mix(vec3(0.24, 0.23, 0.24), vec3(0.42, 0.44, 0.48), 0.5 + 0.5 * normal.z);
    float lit = max((dot(normal, key) + wrap) / (1.0 + wrap), 0.0);
    float filled = max(dot(normal, fill), 0.0);
    vec3 light = sky + lit * vec3(0.74, 0.72, 0.69) + filled * vec3(0.10, 0.11, 0.13);
    float away = 1.0 - max(dot(normal, sight), 0.0);
    float near = max(dot(normal, normalize(key + sight)), 0.0);
    near *= near;
    near *= near;
    near *= near;
    near *= near;
    near *= near * near;
    away *= away;
    float shine = gloss * (0.35 * near + 0.22 * away * away);
    vec3 linear = own() * light + vec3(shine);
    result = vec4(sqrt(clamp(linear, 0.0, 1.0)), 1.0);
}
";

const SHADED: &str = "
uniform vec4 surface;
in vec4 col;
vec3 own() { return surface.rgb * col.rgb; }
";

const PAINTED: &str = "
uniform vec4 surface;
in vec4 col;
vec3 own() { return mix(surface.rgb, col.rgb, col.a); }
";

/// Pictures are as the screen is told.
const PICTURED: &str = "
uniform vec4 surface;
uniform sampler2D picture;
in vec2 uvs;
in vec4 col;
vec3 own() {
    vec3 seen = texture(picture, uvs).rgb;
    return mix(surface.rgb * seen * seen, col.rgb, col.a);
}
";

const BACKDROP: &str = "
in vec2 uvs;
layout (location = 0) out vec4 result;

void main() {
    result = vec4(mix(vec3(0.78, 0.80, 0.83), vec3(0.94, 0.95, 0.96), uvs.y), 1.0);
}
";

impl Material for Shaded {
    fn fragment_shader_source(&self, _: &[&dyn Light]) -> String {
        [SHADED, LIT].concat()
    }

    fn id(&self) -> EffectMaterialId {
        EffectMaterialId(1)
    }

    fn use_uniforms(&self, program: &Program, viewer: &dyn Viewer, _: &[&dyn Light]) {
        light(program, viewer, self.gloss, self.wrap);
        program.use_uniform("surface", linear(self.colour));
    }

    fn render_states(&self) -> RenderStates {
        let cull = if self.one_sided { Cull::Back } else { Cull::None };
        RenderStates { cull, ..RenderStates::default() }
    }

    fn material_type(&self) -> MaterialType {
        MaterialType::Opaque
    }
}

impl Material for Painted {
    fn fragment_shader_source(&self, _: &[&dyn Light]) -> String {
        [if self.picture.is_some() { PICTURED } else { PAINTED }, LIT].concat()
    }

    fn id(&self) -> EffectMaterialId {
        EffectMaterialId(if self.picture.is_some() { 4 } else { 3 })
    }

    fn use_uniforms(&self, program: &Program, viewer: &dyn Viewer, _: &[&dyn Light]) {
        light(program, viewer, TISSUE.0, TISSUE.1);
        program.use_uniform("surface", self.colour);
        if let Some(picture) = &self.picture {
            program.use_texture("picture", picture);
        }
    }

    fn render_states(&self) -> RenderStates {
        RenderStates::default()
    }

    fn material_type(&self) -> MaterialType {
        MaterialType::Opaque
    }
}

impl Material for Backdrop {
    fn fragment_shader_source(&self, _: &[&dyn Light]) -> String {
        BACKDROP.into()
    }

    fn id(&self) -> EffectMaterialId {
        EffectMaterialId(2)
    }

    fn use_uniforms(&self, _: &Program, _: &dyn Viewer, _: &[&dyn Light]) {}

    fn render_states(&self) -> RenderStates {
        RenderStates { depth_test: DepthTest::Always, write_mask: WriteMask::COLOR, ..Default::default() }
    }

    fn material_type(&self) -> MaterialType {
        MaterialType::Opaque
    }
}

/// Gloss and wrap of moist tissue.
pub const TISSUE: (f32, f32) = (0.5, 0.3);

/// The lights go with the eye: whatever side is looked at is lit from above its left shoulder.
fn light(program: &Program, viewer: &dyn Viewer, gloss: f32, wrap: f32) {
    let view = viewer.view();
    let (right, up, back) = (row(&view, 0), row(&view, 1), row(&view, 2));
    program.use_uniform("eye", viewer.position());
    program.use_uniform("key", (-0.42 * right + 0.62 * up + 0.8 * back).normalize());
    program.use_uniform("fill", (0.9 * right - 0.1 * up + 0.4 * back).normalize());
    program.use_uniform("gloss", gloss);
    program.use_uniform("wrap", wrap);
}

/// How bright a colour is, as the shader counts: the square root that it ends with gives the same colour back.
pub fn linear(colour: Srgba) -> Vec4 {
    let part = |channel: u8| (f32::from(channel) / 255.0).powi(2);
    vec4(part(colour.r), part(colour.g), part(colour.b), 1.0)
}

/// An axis of the eye in the world: a row of the view matrix.
fn row(view: &three_d::Mat4, number: usize) -> Vec3 {
    vec3(view.x[number], view.y[number], view.z[number])
}
