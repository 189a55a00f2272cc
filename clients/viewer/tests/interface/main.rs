//! The viewer from outside: recordings in, panels and input, all without a display.

mod panels;
mod pressed_ball;
mod recordings;
mod screen;
