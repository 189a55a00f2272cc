//! What is in a picture: told by regions and colours, not by bytes.

use palpate_viewer::snapshot::Snapshot;

/// The part of `region` for which `holds`.
pub fn part(region: impl Iterator<Item = [u8; 3]>, holds: impl Fn([u8; 3]) -> bool) -> f32 {
    let (held, all) = region.fold((0, 0), |(held, all), pixel| (held + u32::from(holds(pixel)), all + 1));
    held as f32 / all as f32
}

/// Mean red, green and blue.
pub fn mean(region: impl Iterator<Item = [u8; 3]>) -> [f32; 3] {
    let (sum, all) =
        region.fold(([0.0; 3], 0.0), |(sum, all), p| ([0, 1, 2].map(|c| sum[c] + f32::from(p[c])), all + 1.0));
    sum.map(|sum| sum / all)
}

pub fn all(picture: &Snapshot) -> impl Iterator<Item = [u8; 3]> + '_ {
    picture.pixels.iter().copied()
}

/// Tissue: clearly more red than green and blue.
pub fn is_tissue([r, g, b]: [u8; 3]) -> bool {
    i32::from(r) > i32::from(g) + 40 && i32::from(r) > i32::from(b) + 40
}

/// Tissue of the second organ: between red and violet.
pub fn is_second_tissue([r, g, b]: [u8; 3]) -> bool {
    i32::from(r) > i32::from(g) + 20 && i32::from(b) > i32::from(g) + 12
}

/// The finest of three levels: yellow.
pub fn is_fine([r, g, b]: [u8; 3]) -> bool {
    i32::from(r) > i32::from(b) + 70 && i32::from(g) > i32::from(b) + 50
}

/// The coarsest level: blue.
pub fn is_coarse([r, g, b]: [u8; 3]) -> bool {
    i32::from(b) > i32::from(r) + 60 && i32::from(b) > i32::from(g) + 30
}

/// The force's arrow and its number.
pub fn is_force([r, g, b]: [u8; 3]) -> bool {
    i32::from(b) > i32::from(r) + 60 && i32::from(b) > i32::from(g) + 30
}
