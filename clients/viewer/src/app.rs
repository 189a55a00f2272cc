//! What is on the screen: a source, where it stands, and how it is looked at.

use crate::colour::Colouring;
use crate::contact::PlacedTool;
use crate::deformation::Deformation;
use crate::history::History;
use crate::obstacle::Obstacle;
use crate::orbit::{Angle, Orbit, bounds};
use crate::poke::{Felt, Poke, Press, Reach};
use crate::scenes::{LocalServer, Scenes};
use crate::source::{Link, Live, LiveView, Moment, Recording, SourceError, Subject};
use crate::tool_shape::ToolShape;
use palpate_sdk::{Endpoints, Status};
use std::sync::Arc;
use three_d::{InnerSpace, Vec3};

/// Where pictures come from.
pub enum Source {
    /// A running server.
    Live(Live),
    /// A file, shown from its first frame on.
    Recording(Box<Recording>),
}

/// All that a picture is made from.
pub struct App {
    source: Source,
    /// What the colour on the organ means.
    pub colouring: Colouring,
    /// Whether plots and buttons are shown.
    pub panels: bool,
    /// Whether the keys are explained.
    pub help: bool,
    /// The picture is held (live), or time is (recording).
    pub paused: bool,
    /// Where a recording stands [s] from its first frame.
    pub time: f64,
    /// From where a body is first looked at, and when it is fitted again.
    pub angle: Angle,
    /// Where the picture is taken from; fitted to the body when it is first seen.
    pub orbit: Option<Orbit>,
    /// (organs) which of them are not drawn, and let the pointer through.
    pub hidden: Vec<bool>,
    body: Option<Body>,
    moment: Moment,
    status: Status,
    /// What is wrong with the source, if anything.
    notice: Option<String>,
    history: History,
    /// What can be chosen from; `None` where no server can be started.
    pub scenes: Option<Scenes>,
    server: Option<LocalServer>,
    pub(crate) poke: Option<Poke>,
    pub(crate) pressing: Option<Pressing>,
}

/// The body that is looked at, with what follows from its rest shape.
#[derive(Clone)]
pub struct Body {
    /// As the source describes it.
    pub subject: Arc<Subject>,
    /// Against its rest shape.
    pub deformation: Arc<Deformation>,
    /// Corners of its box at rest [m].
    pub bounds: [Vec3; 2],
    /// Mean length of an edge at rest [m].
    pub edge: f32,
    /// The shapes of its tools, by number.
    pub tools: Vec<Arc<ToolShape>>,
    /// Its obstacles, in the order of the session; `None` for one that makes no sense.
    pub obstacles: Vec<Option<Obstacle>>,
}

/// A press of the mouse on the organ, as long as it lasts.
pub struct Pressing {
    /// The surface on which the pointer glides: as it was before the tool dented it.
    pub surface: Vec<[f32; 3]>,
    /// Where it presses now.
    pub press: Press,
}

impl Body {
    fn new(subject: Arc<Subject>) -> Self {
        let bounds = bounds(&subject.surface.rest_positions).into();
        let deformation = Arc::new(Deformation::new(&subject.surface));
        let tools = subject.tools.iter().map(|tool| Arc::new(ToolShape::new(tool))).collect();
        let edge = deformation.edge();
        let mut body = Self { edge, deformation, tools, obstacles: Vec::new(), subject, bounds };
        body.obstacles = body.subject.obstacles.iter().map(|of| Obstacle::new(of, body.centre())).collect();
        body
    }

    /// Diagonal of the box at rest [m].
    pub fn size(&self) -> f32 {
        (self.bounds[1] - self.bounds[0]).magnitude()
    }

    /// Whether the tool of this number has jaws.
    pub fn has_jaws(&self, tool: u32) -> bool {
        let description = self.subject.tools.iter().find(|description| description.tool == tool);
        description.is_some_and(|description| description.parts.iter().any(|part| part.hinge.is_some()))
    }

    fn centre(&self) -> Vec3 {
        0.5 * (self.bounds[0] + self.bounds[1])
    }
}

impl App {
    /// Watches a server.
    pub fn live(endpoints: &Endpoints) -> Self {
        Self::new(Source::Live(Live::watch(endpoints)))
    }

    /// Plays a recording. Errors: those of its first frame.
    pub fn recording(recording: Recording) -> Result<Self, SourceError> {
        let mut app = Self::new(Source::Recording(Box::new(recording)));
        app.advance(0.0)?;
        Ok(app)
    }

    fn new(source: Source) -> Self {
        let history = match &source {
            Source::Recording(recording) => History::of_recording(recording.frames()),
            Source::Live(_) => History::default(),
        };
        Self {
            source,
            colouring: Colouring::default(),
            panels: true,
            help: false,
            paused: false,
            time: 0.0,
            angle: Angle::default(),
            orbit: None,
            hidden: Vec::new(),
            body: None,
            moment: Moment::default(),
            status: Status::default(),
            notice: None,
            history,
            scenes: None,
            server: None,
            poke: None,
            pressing: None,
        }
    }

    /// Takes what has come, or goes on by `seconds` in a recording.
    ///
    /// # Errors
    /// When the recording cannot be read any more.
    pub fn advance(&mut self, seconds: f64) -> Result<(), SourceError> {
        match &mut self.source {
            Source::Live(live) => {
                let LiveView { link, subject, moment, status, .. } = live.view();
                self.notice = match link {
                    Link::Open => None,
                    Link::Waiting(None) => Some("waiting for frames".into()),
                    Link::Waiting(Some(why)) => Some(format!("connecting again: {why}")),
                };
                self.history.add_status(&status);
                self.status = status;
                if let Some(subject) = subject {
                    self.look_at(subject);
                }
                if let Some(moment) = moment.filter(|_| !self.paused) {
                    self.history.add(&moment);
                    self.moment = moment;
                }
            }
            Source::Recording(recording) => {
                if !self.paused {
                    self.time += seconds;
                }
                if self.time >= recording.duration() {
                    (self.time, self.paused) = (recording.duration(), true);
                }
                self.time = self.time.max(0.0);
                self.moment = recording.at(self.time)?;
                self.notice = recording.cut().map(|why| format!("the recording is cut short: {why}"));
                let subject = recording.subject().clone();
                self.look_at(subject);
            }
        }
        Ok(())
    }

    fn look_at(&mut self, subject: Arc<Subject>) {
        if self.body.as_ref().is_none_or(|body| !Arc::ptr_eq(&body.subject, &subject)) {
            let body = Body::new(subject);
            // The same body after a new connection is looked at from the same side.
            let same = self.body.as_ref().is_some_and(|old| old.bounds == body.bounds);
            if self.orbit.is_none() || !same {
                self.orbit = Some(Orbit::around(&body.subject.surface.rest_positions, self.angle));
                self.hidden.clear();
            }
            self.hidden.resize(body.subject.surface.organs.len(), false);
            if self.moment.positions.len() != body.subject.surface.rest_positions.len() {
                self.moment = Moment::at_rest(&body.subject.surface);
            }
            self.body = Some(body);
        }
    }

    /// The body that is looked at; `None` before the first connection.
    pub fn body(&self) -> Option<&Body> {
        self.body.as_ref()
    }

    /// The triangles of the organs that are shown; of the others, as many without any area.
    pub fn shown_triangles(&self) -> Vec<[u32; 3]> {
        let Some(body) = &self.body else { return Vec::new() };
        let mut triangles = body.subject.surface.triangles.clone();
        for ([_, own], _) in body.subject.surface.ranges().zip(&self.hidden).filter(|(_, hidden)| **hidden) {
            triangles[own].fill([0; 3]);
        }
        triangles
    }

    /// How it looks.
    pub fn moment(&self) -> &Moment {
        &self.moment
    }

    /// The tools that somebody holds.
    pub fn tools(&self) -> Vec<PlacedTool> {
        let shapes = self.body.as_ref().map_or(&[][..], |body| &body.tools);
        let placed = self.moment.tools.iter().filter_map(|state| PlacedTool::new(state, shapes));
        placed.filter(|tool| tool.held).collect()
    }

    /// How the server fares; empty in a recording.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// What is wrong with the source.
    pub fn notice(&self) -> Option<&str> {
        self.notice.as_deref()
    }

    /// Shows what went wrong.
    pub fn say(&mut self, notice: String) {
        self.notice = Some(notice);
    }

    /// True while the picture is an old one, because nothing comes.
    pub fn stale(&self) -> bool {
        matches!(self.source, Source::Live(_)) && self.notice.is_some()
    }

    /// The curves of the plots.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The recording, where it is one.
    pub fn recorded(&self) -> Option<&Recording> {
        match &self.source {
            Source::Recording(recording) => Some(recording),
            Source::Live(_) => None,
        }
    }

    /// Goes to the next frame of a recording, or the one before, and stays there.
    pub fn step(&mut self, forward: bool) {
        let Source::Recording(recording) = &self.source else { return };
        self.paused = true;
        let first = recording.frames()[0].tick;
        let now = first as f64 + self.time / crate::source::TICK;
        let frames = recording.frames();
        let next = if forward {
            frames.iter().find(|frame| frame.tick as f64 > now + 0.5)
        } else {
            frames.iter().rev().find(|frame| (frame.tick as f64) < now - 0.5)
        };
        if let Some(frame) = next {
            self.time = (frame.tick - first) as f64 * crate::source::TICK;
        }
    }

    /// Plays or pauses; at the end of a recording it begins again.
    pub fn toggle_pause(&mut self) {
        self.paused = !self.paused;
        if let Source::Recording(recording) = &self.source
            && self.time >= recording.duration()
        {
            self.time = 0.0;
        }
    }

    /// Puts the body of a live session back into its starting state; a recording goes to its start.
    pub fn reset(&mut self) {
        match &self.source {
            Source::Live(live) => live.reset(),
            Source::Recording(_) => self.time = 0.0,
        }
    }

    /// Starts a server of the bundled scene `name` and watches it, instead of whatever was watched.
    pub fn choose_scene(&mut self, name: &str) {
        let Some(scenes) = self.scenes.take() else { return };
        match scenes.start(name) {
            Ok(server) => {
                let kept = (self.colouring, self.panels, self.angle);
                *self = Self { scenes: None, ..Self::live(server.endpoints()) };
                (self.colouring, self.panels, self.angle) = kept;
                self.server = Some(server);
            }
            Err(e) => self.say(e),
        }
        self.scenes = Some(scenes);
    }

    /// Looks at the whole body again.
    pub fn fit(&mut self) {
        let body = self.body.as_ref();
        self.orbit = body.map(|body| Orbit::around(&body.subject.surface.rest_positions, self.angle));
    }

    /// Takes a free tool of a live session into the mouse's hand, or lets go of it.
    pub fn toggle_poke(&mut self) {
        self.pressing = None;
        if self.poke.take().is_some() {
            return;
        }
        let (Source::Live(live), Some(body)) = (&self.source, &self.body) else { return };
        let held = |tool: u32| self.moment.tools.iter().any(|state| state.tool == tool);
        let description = body.subject.tools.iter().find(|tool| !held(tool.tool));
        // A cylinder touches with its end, the others with what lies around the reference point.
        let tool = description.filter(|tool| tool.shape != "cylinder").map_or(0.0, |tool| tool.radius as f32);
        let reach = Reach { centre: body.centre(), radius: 0.5 * body.size(), tool };
        let name = description.map_or("", |tool| &tool.name);
        self.poke = Some(Poke::take(live.endpoints(), name, reach));
    }

    /// Opens or closes the jaws of the tool in the mouse's hand.
    pub fn toggle_jaws(&mut self) {
        if let Some(poke) = &self.poke {
            poke.toggle_jaws();
        }
    }

    /// What the mouse's tool feels, where it holds one.
    pub fn felt(&self) -> Option<Felt> {
        self.poke.as_ref().map(Poke::felt)
    }
}
