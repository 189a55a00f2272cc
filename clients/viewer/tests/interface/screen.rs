//! A screen without a display, and what can be read on it.

use palpate_viewer::app::App;
use palpate_viewer::panels;
use palpate_viewer::three_d::egui::{Context, Event, Modifiers, PointerButton, Pos2, RawInput, Rect, vec2};

/// What is written, and where.
#[derive(Debug)]
pub struct Text {
    /// All of its box [points].
    pub rect: Rect,
    /// What it says.
    pub words: String,
    /// True when nothing cuts it off.
    pub whole: bool,
}

/// A screen to show an app on, and a user in front of it.
pub struct Screen {
    context: Context,
    time: f64,
}

impl Screen {
    /// Nothing on it yet.
    pub fn new() -> Self {
        let context = Context::default();
        panels::style(&context);
        Self { context, time: 0.0 }
    }

    /// Shows `app` on 1280 × 800 points after the user did `events`; all text that is on the screen, with its box.
    pub fn show(&mut self, app: &mut App, events: Vec<Event>) -> (Rect, Vec<Text>) {
        self.time += 0.1;
        let input = RawInput {
            screen_rect: Some(Rect::from_min_size(Pos2::ZERO, vec2(1280.0, 800.0))),
            time: Some(self.time),
            events,
            ..Default::default()
        };
        let mut free = Rect::ZERO;
        let output = self.context.run_ui(input, |ui| free = panels::show(ui, app));
        let mut texts = Vec::new();
        for clipped in output.shapes {
            collect(&clipped.shape, clipped.clip_rect, &mut texts);
        }
        (free, texts)
    }
}

fn collect(shape: &palpate_viewer::three_d::egui::Shape, clip: Rect, texts: &mut Vec<Text>) {
    match shape {
        palpate_viewer::three_d::egui::Shape::Text(text) => {
            let rect = text.visual_bounding_rect();
            if rect.intersect(clip).is_positive() {
                let whole = clip.expand(1.0).contains_rect(rect);
                texts.push(Text { rect, words: text.galley.text().to_owned(), whole });
            }
        }
        palpate_viewer::three_d::egui::Shape::Vec(shapes) => {
            shapes.iter().for_each(|shape| collect(shape, clip, texts))
        }
        _ => {}
    }
}

/// The mouse goes to `pos` and presses a button there, or lets it go.
pub fn button(pos: Pos2, button: PointerButton, pressed: bool) -> Vec<Event> {
    vec![Event::PointerMoved(pos), Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }]
}

/// True when `part` is on the screen.
pub fn said(texts: &[Text], part: &str) -> bool {
    texts.iter().any(|text| text.words.contains(part))
}

/// Every text is whole and none lies over another.
pub fn readable(texts: &[Text]) {
    for (number, text) in texts.iter().enumerate() {
        assert!(text.whole, "cut off: {text:?}");
        for other in &texts[..number] {
            let overlap = text.rect.shrink(1.5).intersect(other.rect.shrink(1.5));
            assert!(!overlap.is_positive(), "{text:?} over {other:?}");
        }
    }
}
