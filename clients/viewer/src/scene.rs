//! The three-dimensional part of a picture: organ, tools and force arrows, drawn with OpenGL.

use crate::app::App;
use crate::colour::Colouring;
use crate::contact::PlacedTool;
use crate::obstacle::{Form, Obstacle};
use crate::shading::{Backdrop, Painted, Shaded, TISSUE, linear};
use crate::source::{Picture, Subject};
use crate::tool_shape::Skin;
use std::collections::BTreeMap;
use std::sync::Arc;
use three_d::{
    Camera, Context, CpuMesh, CpuTexture, Geometry, Indices, InnerSpace, Mat4, Mesh, Positions, Quat, Rotation, Srgba,
    Texture2D, TextureData, Vec3, Vec4, apply_screen_material, vec2, vec3, vec4,
};

/// Length of an arrow for the largest force that a tool renders, in diagonals of the body.
const LONGEST_ARROW: f32 = 0.5;
/// Steel.
const TOOL: Srgba = Srgba::new_opaque(170, 178, 188);
/// Bone.
const OBSTACLE: Srgba = Srgba::new_opaque(222, 214, 196);
/// Squares of the ground.
const GROUND: [Srgba; 2] = [Srgba::new_opaque(206, 211, 216), Srgba::new_opaque(194, 200, 206)];
/// A force.
const FORCE: Srgba = Srgba::new_opaque(28, 96, 200);
/// Where a tool touches tissue, which turns pale (linear).
const PALE: Vec3 = Vec3::new(1.0, 0.86, 0.5);
/// Where a tool touches and a colour means a number: none of the scales' colours (linear).
const DARK: Vec3 = Vec3::new(0.05, 0.05, 0.07);
/// What everything fades to when nothing comes any more (linear).
const GREY: Vec3 = Vec3::new(0.35, 0.36, 0.38);
/// Sides of round things.
const SIDES: u32 = 32;

/// Meshes on the graphics card.
pub struct Scene {
    context: Context,
    /// With what they are made from: the subject, and which organs are hidden.
    organs: Option<(Arc<Subject>, Vec<bool>, Vec<Group>)>,
    /// Whether materials are shown, and no numbers by colours.
    painted: bool,
    tools: Vec<Vec<Mesh>>,
    /// Those of each obstacle.
    obstacles: Vec<Vec<Mesh>>,
    cylinder: Mesh,
    cone: Mesh,
}

impl Scene {
    /// An empty one.
    pub fn new(context: &Context) -> Self {
        let mesh = |cpu: CpuMesh| Mesh::new(context, &cpu);
        Self {
            context: context.clone(),
            organs: None,
            painted: true,
            tools: Vec::new(),
            obstacles: Vec::new(),
            cylinder: mesh(CpuMesh::cylinder(SIDES)),
            cone: mesh(CpuMesh::cone(SIDES)),
        }
    }

    /// Takes over how the body looks now.
    pub fn update(&mut self, app: &App) {
        let Some(body) = app.body() else { return };
        let moment = app.moment();
        let vertices = moment.positions.len();
        let same = |(subject, hidden, _): &(Arc<Subject>, Vec<bool>, Vec<Group>)| {
            Arc::ptr_eq(subject, &body.subject) && *hidden == app.hidden
        };
        if !self.organs.as_ref().is_some_and(same) {
            let groups = groups(&self.context, &body.subject, &app.shown_triangles());
            self.organs = Some((body.subject.clone(), app.hidden.clone(), groups));
            self.tools = body.tools.iter().map(|shape| skin_meshes(&self.context, &shape.skins)).collect();
            let meshes = |of: &Option<Obstacle>| match of.as_ref().map(|of| &of.form) {
                Some(Form::Parts(skins)) => skin_meshes(&self.context, skins),
                Some(Form::Ground { middle }) => vec![ground_mesh(&self.context, *middle, body.size())],
                None => Vec::new(),
            };
            self.obstacles = body.obstacles.iter().map(meshes).collect();
        }
        let Some((.., groups)) = &mut self.organs else { return };
        let positions: Vec<Vec3> = moment.positions.iter().map(|&position| position.into()).collect();
        let mut touch = vec![0.0; vertices];
        for tool in app.tools() {
            tool.add_touch(&moment.positions, body.edge, &mut touch);
        }
        let faded = if app.stale() { 0.8 } else { 0.0 };
        let colours = app.colouring.colours(&body.deformation, moment, body.size());
        let (mark, strength) = if app.colouring == Colouring::Material { (PALE, 0.75) } else { (DARK, 0.35) };
        let colours = colours.iter().zip(&touch).map(|(colour, touch)| {
            let own = linear(*colour).truncate();
            let touched = own + strength * *touch * (mark - own);
            (touched + faded * (GREY - touched)).extend(1.0)
        });
        let colours: Vec<Vec4> = colours.collect();
        // The same over a material of its own: what covers it, and how far.
        let covers = touch.iter().map(|touch| {
            let (touched, cover) = (strength * touch, 1.0 - (1.0 - strength * touch) * (1.0 - faded));
            let sum = touched * (1.0 - faded) * mark + faded * GREY;
            (sum / cover.max(1e-6)).extend(cover)
        });
        let covers: Vec<Vec4> = covers.collect();
        let normals = body.deformation.normals(&moment.positions);
        self.painted = app.colouring == Colouring::Material;
        for group in groups {
            let colours = if self.painted && group.painted.is_some() { &covers } else { &colours };
            group.update(&positions, &normals, colours);
        }
    }

    /// Draws into the render target that is being written: the backdrop behind all of `whole`, the rest as `camera` sees it.
    pub fn draw(&mut self, app: &App, whole: &Camera, camera: &Camera) {
        apply_screen_material(&self.context, Backdrop, whole, &[]);
        for group in self.organs.iter().flat_map(|(.., groups)| groups) {
            match &group.painted {
                Some(painted) if self.painted => group.mesh.render_with_material(painted, camera, &[]),
                _ => {
                    let (gloss, wrap) = TISSUE;
                    group.mesh.render_with_material(
                        &Shaded { colour: Srgba::WHITE, gloss, wrap, one_sided: false },
                        camera,
                        &[],
                    );
                }
            }
        }
        let Some(body) = app.body() else { return };
        let states = &app.moment().obstacles;
        for (i, (obstacle, meshes)) in body.obstacles.iter().zip(&mut self.obstacles).enumerate() {
            let Some(obstacle) = obstacle else { continue };
            let material = match obstacle.form {
                Form::Ground { .. } => Shaded { colour: Srgba::WHITE, gloss: 0.0, wrap: 0.3, one_sided: true },
                Form::Parts(_) => Shaded { colour: OBSTACLE, gloss: 0.2, wrap: 0.3, one_sided: false },
            };
            let position = obstacle.position(states.get(i));
            for mesh in meshes {
                draw(mesh, &material, position, vec3(1.0, 1.0, 1.0), obstacle.orientation, camera);
            }
        }
        let mut brush = Brush { scene: self, camera };
        for tool in app.tools() {
            brush.tool(&tool);
            if let Some(arrow) = Arrow::of(&tool, body.size(), body.subject.force_limit) {
                brush.arrow(&arrow, 0.006 * body.size());
            }
        }
    }
}

/// Triangles of one material.
struct Group {
    mesh: Mesh,
    /// Numbers of its vertices in the surface.
    vertices: Vec<u32>,
    /// What it looks like; `None`: as its vertices are coloured.
    painted: Option<Painted>,
}

impl Group {
    /// Places, normals and colours of all vertices of the surface are now these.
    fn update(&mut self, positions: &[Vec3], normals: &[Vec3], colours: &[Vec4]) {
        let own = |of: &[Vec3]| self.vertices.iter().map(|v| of[*v as usize]).collect::<Vec<_>>();
        let (positions, normals) = (own(positions), own(normals));
        let colours: Vec<Vec4> = self.vertices.iter().map(|v| colours[*v as usize]).collect();
        // Of an indexed mesh three-d counts corners instead of vertices, so that only partial updates fit.
        let fits = self.mesh.set_positions_partially(0, &positions).is_ok()
            && self.mesh.set_normals_partially(0, &normals).is_ok()
            && self.mesh.set_colors_partially(0, &colours).is_ok();
        debug_assert!(fits, "the mesh was made for this surface");
    }
}

/// The `triangles` of the surface of `subject`, of which those without area are hidden, one group for each material.
fn groups(context: &Context, subject: &Subject, triangles: &[[u32; 3]]) -> Vec<Group> {
    let texture = |picture: &Picture| {
        let image = CpuTexture {
            data: TextureData::RgbaU8(picture.pixels.clone()),
            width: picture.width,
            height: picture.height,
            ..Default::default()
        };
        (picture.number, Arc::new(Texture2D::new(context, &image)))
    };
    let pictures: BTreeMap<u32, Arc<Texture2D>> = subject.pictures.iter().map(texture).collect();
    let surface = &subject.surface;
    let (mut groups, mut rest) = (Vec::new(), triangles);
    let mut add = |triangles: &[[u32; 3]], painted: Option<Painted>| {
        let mut number = BTreeMap::new();
        let mut vertices = Vec::new();
        let mut indices = Vec::new();
        for v in triangles.iter().filter(|[a, b, _]| a != b).flatten() {
            indices.push(*number.entry(*v).or_insert_with(|| {
                vertices.push(*v);
                vertices.len() as u32 - 1
            }));
        }
        if vertices.is_empty() {
            return;
        }
        let uv = |v: &u32| surface.uvs.get(*v as usize).map_or(vec2(0.0, 0.0), |[u, v]| vec2(*u, *v));
        let mesh = CpuMesh {
            positions: Positions::F32(vec![vec3(0.0, 0.0, 0.0); vertices.len()]),
            indices: Indices::U32(indices),
            normals: Some(vec![Vec3::unit_z(); vertices.len()]),
            uvs: Some(vertices.iter().map(uv).collect()),
            colors: Some(vec![Srgba::WHITE; vertices.len()]),
            ..Default::default()
        };
        groups.push(Group { mesh: Mesh::new(context, &mesh), vertices, painted });
    };
    for material in &surface.materials {
        let own;
        (own, rest) = rest.split_at(material.triangles.min(rest.len()));
        let painted = material.colour.map(|[r, g, b]| Painted {
            colour: vec4(r, g, b, 1.0),
            picture: material.picture.and_then(|number| pictures.get(&number).cloned()),
        });
        add(own, painted);
    }
    add(rest, None);
    groups
}

/// A force as it is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Arrow {
    /// Where it starts: at the tool [m].
    pub start: Vec3,
    /// From start to tip [m].
    pub way: Vec3,
    /// What it says [N].
    pub newtons: f32,
}

impl Arrow {
    /// That of the force on `tool`; `None` where it feels nothing. `size` is the body's diagonal [m], `limit` the largest
    /// force that is rendered [N].
    pub fn of(tool: &PlacedTool, size: f32, limit: f32) -> Option<Self> {
        let newtons = tool.force.magnitude();
        let start = tool.position + tool.shape.radius * tool.force / newtons.max(1e-9);
        let way = LONGEST_ARROW * size / limit.max(1e-3) * tool.force;
        (newtons > 0.005).then_some(Self { start, way, newtons })
    }
}

/// Draws unit meshes in many places.
struct Brush<'a> {
    scene: &'a mut Scene,
    camera: &'a Camera,
}

impl Brush<'_> {
    fn tool(&mut self, tool: &PlacedTool) {
        let steel = Shaded { colour: TOOL, gloss: 1.0, wrap: 0.1, one_sided: false };
        let meshes = self.scene.tools.get_mut(tool.shape_of).into_iter().flatten();
        for (mesh, skin) in meshes.zip(&tool.shape.skins) {
            let (moved, turn) = skin.turned(tool.opening);
            let place = tool.position + tool.orientation.rotate_vector(moved);
            draw(mesh, &steel, place, vec3(1.0, 1.0, 1.0), tool.orientation * turn, self.camera);
        }
    }

    fn arrow(&mut self, arrow: &Arrow, radius: f32) {
        let blue = Shaded { colour: FORCE, gloss: 0.2, wrap: 0.4, one_sided: false };
        let length = arrow.way.magnitude();
        let turn = Quat::between_vectors(Vec3::unit_x(), arrow.way / length);
        let head = (4.0 * radius).min(0.6 * length);
        let neck = arrow.start + arrow.way.normalize_to(length - head);
        self.cylinder(&blue, arrow.start, vec3(length - head, radius, radius), turn);
        self.cone(&blue, neck, vec3(head, 0.55 * head, 0.55 * head), turn);
    }

    fn cylinder(&mut self, material: &Shaded, at: Vec3, scale: Vec3, turn: Quat) {
        draw(&mut self.scene.cylinder, material, at, scale, turn, self.camera);
    }

    fn cone(&mut self, material: &Shaded, at: Vec3, scale: Vec3, turn: Quat) {
        draw(&mut self.scene.cone, material, at, scale, turn, self.camera);
    }
}

fn draw(mesh: &mut Mesh, material: &Shaded, at: Vec3, scale: Vec3, turn: Quat, camera: &Camera) {
    let scaled = Mat4::from_nonuniform_scale(scale.x, scale.y, scale.z);
    mesh.set_transformation(Mat4::from_translation(at) * Mat4::from(turn) * scaled);
    mesh.render_with_material(material, camera, &[]);
}

/// The ground around `middle` [m] in squares of a round length; `size` [m]: how far it goes.
fn ground_mesh(context: &Context, middle: Vec3, size: f32) -> Mesh {
    let decade = 10f32.powf((0.2 * size).log10().floor());
    let edge = [5.0, 2.0].into_iter().map(|of| of * decade).find(|edge| *edge <= 0.2 * size).unwrap_or(decade);
    let squares = (size / edge).ceil() as i32;
    let of_middle = |c: f32| (c / edge).round() as i32;
    let (mut positions, mut colors) = (Vec::new(), Vec::new());
    for (i, j) in (-squares..squares).flat_map(|i| (-squares..squares).map(move |j| (i, j))) {
        let (i, j) = (i + of_middle(middle.x), j + of_middle(middle.y));
        for (a, b) in [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)] {
            positions.push(vec3((i + a) as f32 * edge, (j + b) as f32 * edge, 0.0));
            colors.push(GROUND[(i + j).rem_euclid(2) as usize]);
        }
    }
    let mesh = CpuMesh {
        normals: Some(vec![Vec3::unit_z(); positions.len()]),
        positions: Positions::F32(positions),
        colors: Some(colors),
        ..Default::default()
    };
    Mesh::new(context, &mesh)
}

/// One for each part.
fn skin_meshes(context: &Context, skins: &[Skin]) -> Vec<Mesh> {
    let mesh = |skin: &Skin| {
        let mesh = CpuMesh {
            positions: Positions::F32(skin.points.clone()),
            normals: Some(skin.normals.clone()),
            indices: Indices::U32(Skin::triangles()),
            ..Default::default()
        };
        Mesh::new(context, &mesh)
    };
    skins.iter().map(mesh).collect()
}
