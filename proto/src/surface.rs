//! How the vertices of a surface travel: on a grid, as differences from a reference, predicted from their neighbours.
//!
//! A coordinate x [m] stands on the grid as the whole number `floor(x / step + 1/2)`; the step is part of the topology.
//! A frame is cut into parts of [`VERTICES_PER_PART`] vertices, and each part is coded by itself:
//!
//! 1. the difference of every vertex from the reference, on the grid: a key frame's reference is the surface at rest,
//!    that of any other frame its key frame;
//! 2. minus the mean of the differences of the vertex's earlier neighbours, which are the vertices of smaller number in
//!    the same part that share a triangle with it: of sum s over n of them, `floor((2 s + n) / 2 n)`, 0 where n is 0;
//! 3. zigzag (0, −1, 1, −2 → 0, 1, 2, 3), the lowest byte of all x, all y and all z, then the second byte of all, the
//!    third, the fourth; and these 12 bytes a vertex compressed by zstd.
//!
//! Levels of detail, a byte a vertex, are coded alike: minus the level of the earlier neighbour of the greatest number,
//! modulo 256, then zstd. All whole numbers are 32 bits wide and wrap, so that whatever is coded comes back.
//!
//! A vertex's prediction needs the vertices before it decoded: a decoder goes through a part in order, and cannot do so in
//! parallel. Vectors that any decoder can be held to stand in `proto/vectors/surface.json`.

/// Vertices of each part of a frame but the last: even if zstd gains nothing, a part with levels and tools stays below
/// [`MOST_MESSAGE_BYTES`].
pub const VERTICES_PER_PART: usize = 4_096;

/// No message of the surface stream is longer: zenoh cuts messages beyond 65,535 bytes into fragments.
pub const MOST_MESSAGE_BYTES: usize = 65_000;

/// Streams that a viewer may choose from: every frame, every second, fourth, eighth.
pub const EVERY: [u32; 4] = [1, 2, 4, 8];

/// A frame in so many is a key frame: two a second, and part of the stream of every eighth.
pub const KEY_INTERVAL: u64 = 16;

/// Largest window of a zstd frame that is decoded [bytes], far more than a part has: what foreign bytes may make a decoder
/// allocate.
const MOST_WINDOW_BYTES: u64 = 1 << 20;

/// zstd's level: on a stroked liver and a stabbed toy, level 3 gains nothing, and lz4 takes 1.2 to 1.9 times the bytes.
#[cfg(feature = "encode")]
const ZSTD_LEVEL: i32 = 1;

/// A vertex on the grid.
pub type GridPoint = [i32; 3];

/// Why bytes are no part of a frame of this surface.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodeError {
    /// There are no such vertices.
    #[error("part {part} of a surface in {parts} parts")]
    Part {
        /// The part's number, counted from 0.
        part: usize,
        /// How many there are.
        parts: usize,
    },
    /// zstd cannot read them, or they are longer than the part.
    #[error("no zstd frame of at most {expected} bytes: {reason}")]
    Compression {
        /// Bytes that the part has uncompressed.
        expected: usize,
        /// What zstd says.
        reason: String,
    },
    /// They are shorter than the part.
    #[error("{got} bytes for a part of {expected}")]
    Length {
        /// Bytes that the part has uncompressed.
        expected: usize,
        /// Bytes that came.
        got: usize,
    },
}

/// The code of one surface: its grid, and which vertices predict which.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceCode {
    step: f64,
    rest: Vec<GridPoint>,
    /// Earlier neighbours of vertex v: `earlier[first[v]..first[v + 1]]`, ascending.
    earlier: Vec<u32>,
    first: Vec<u32>,
}

impl SurfaceCode {
    /// The code of the surface `triangles` (n, 3) with vertices `rest` [m] on a grid of `step` [m], a positive number;
    /// `None` when the step is none, or a triangle names a vertex that does not exist.
    pub fn new(triangles: &[[u32; 3]], rest: &[[f32; 3]], step: f64) -> Option<Self> {
        let exists = |v: &u32| (*v as usize) < rest.len();
        if !(step.is_finite() && step > 0.0 && triangles.iter().flatten().all(exists)) {
            return None;
        }
        let part = |v: u32| v as usize / VERTICES_PER_PART;
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(3 * triangles.len());
        for &[a, b, c] in triangles {
            pairs.extend([(a, b), (b, c), (c, a)].map(|(a, b)| (a.max(b), a.min(b))));
        }
        pairs.retain(|(later, earlier)| earlier < later && part(*earlier) == part(*later));
        pairs.sort_unstable();
        pairs.dedup();
        let before = |v: usize| pairs.partition_point(|pair| (pair.0 as usize) < v) as u32;
        Some(Self {
            step,
            rest: rest.iter().map(|x| on_grid(x.map(f64::from), step)).collect(),
            first: (0..=rest.len()).map(before).collect(),
            earlier: pairs.into_iter().map(|pair| pair.1).collect(),
        })
    }

    /// Vertices of the surface.
    pub fn vertices(&self) -> usize {
        self.rest.len()
    }

    /// Parts that a frame is cut into.
    pub fn parts(&self) -> usize {
        self.rest.len().div_ceil(VERTICES_PER_PART)
    }

    /// Vertices of `part`.
    ///
    /// # Errors
    /// [`CodeError::Part`].
    pub fn part(&self, part: usize) -> Result<std::ops::Range<usize>, CodeError> {
        if part >= self.parts() {
            return Err(CodeError::Part { part, parts: self.parts() });
        }
        let first = part * VERTICES_PER_PART;
        Ok(first..(first + VERTICES_PER_PART).min(self.rest.len()))
    }

    /// The surface at rest (vertices): what key frames refer to.
    pub fn rest(&self) -> &[GridPoint] {
        &self.rest
    }

    /// Where `x` [m] stands on the grid: half a step away at most, in each coordinate. What lies beyond 2³¹ steps stands
    /// at the grid's end.
    pub fn on_grid(&self, x: [f64; 3]) -> GridPoint {
        on_grid(x, self.step)
    }

    /// Position of `point` [m].
    pub fn position(&self, point: GridPoint) -> [f32; 3] {
        point.map(|n| (f64::from(n) * self.step) as f32)
    }

    /// Codes the vertices of `part` of `now` (vertices) against `reference` (vertices).
    ///
    /// # Errors
    /// [`CodeError::Part`], or [`CodeError::Compression`] when zstd has no memory.
    #[cfg(feature = "encode")]
    pub fn encode(&self, part: usize, reference: &[GridPoint], now: &[GridPoint]) -> Result<Vec<u8>, CodeError> {
        let range = self.part(part)?;
        let n = range.len();
        let mut planes = vec![0; 12 * n];
        let difference = |v: usize| minus(now[v], reference[v]);
        for v in range.clone() {
            let residual = minus(difference(v), self.predicted(v, difference));
            for (c, r) in residual.into_iter().enumerate() {
                let zigzag = ((r << 1) ^ (r >> 31)).to_le_bytes();
                zigzag.into_iter().enumerate().for_each(|(b, byte)| planes[(3 * b + c) * n + v - range.start] = byte);
            }
        }
        compress(&planes)
    }

    /// Decodes the vertices of `part` against `reference` (vertices) into `now` (vertices); whatever the bytes are, it
    /// takes 2 MiB of memory at most.
    ///
    /// # Errors
    /// Every [`CodeError`]; `now` is then as it was.
    pub fn decode(
        &self,
        part: usize,
        reference: &[GridPoint],
        bytes: &[u8],
        now: &mut [GridPoint],
    ) -> Result<(), CodeError> {
        let range = self.part(part)?;
        let n = range.len();
        let planes = decompress(bytes, 12 * n)?;
        for v in range.clone() {
            let residual = [0, 1, 2].map(|c| {
                let zigzag = u32::from_le_bytes([0, 1, 2, 3].map(|b| planes[(3 * b + c) * n + v - range.start]));
                (zigzag >> 1) as i32 ^ -((zigzag & 1) as i32)
            });
            let predicted = self.predicted(v, |v| minus(now[v], reference[v]));
            now[v] = [0, 1, 2].map(|c| reference[v][c].wrapping_add(predicted[c]).wrapping_add(residual[c]));
        }
        Ok(())
    }

    /// Codes the levels of the vertices of `part`; `levels` (vertices).
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    #[cfg(feature = "encode")]
    pub fn encode_levels(&self, part: usize, levels: &[u8]) -> Result<Vec<u8>, CodeError> {
        let residual = |v: usize| levels[v].wrapping_sub(self.earlier(v).last().map_or(0, |e| levels[*e as usize]));
        compress(&self.part(part)?.map(residual).collect::<Vec<_>>())
    }

    /// Decodes the levels of the vertices of `part` into `levels` (vertices).
    ///
    /// # Errors
    /// Every [`CodeError`]; `levels` are then as they were.
    pub fn decode_levels(&self, part: usize, bytes: &[u8], levels: &mut [u8]) -> Result<(), CodeError> {
        let range = self.part(part)?;
        let residuals = decompress(bytes, range.len())?;
        for (v, residual) in range.zip(residuals) {
            levels[v] = residual.wrapping_add(self.earlier(v).last().map_or(0, |e| levels[*e as usize]));
        }
        Ok(())
    }

    fn earlier(&self, v: usize) -> &[u32] {
        &self.earlier[self.first[v] as usize..self.first[v + 1] as usize]
    }

    /// Mean of the differences of the earlier neighbours of vertex `v`, rounded.
    fn predicted(&self, v: usize, difference: impl Fn(usize) -> GridPoint) -> GridPoint {
        let earlier = self.earlier(v);
        let mut sum = [0i64; 3];
        for e in earlier {
            sum.iter_mut().zip(difference(*e as usize)).for_each(|(sum, d)| *sum += i64::from(d));
        }
        let n = earlier.len().max(1) as i64;
        sum.map(|s| (2 * s + n).div_euclid(2 * n) as i32)
    }
}

fn on_grid(x: [f64; 3], step: f64) -> GridPoint {
    x.map(|x| (x / step + 0.5).floor() as i32)
}

fn minus(a: GridPoint, b: GridPoint) -> GridPoint {
    [0, 1, 2].map(|c| a[c].wrapping_sub(b[c]))
}

#[cfg(feature = "encode")]
fn compress(bytes: &[u8]) -> Result<Vec<u8>, CodeError> {
    let failed = |e: std::io::Error| CodeError::Compression { expected: bytes.len(), reason: e.to_string() };
    zstd::bulk::compress(bytes, ZSTD_LEVEL).map_err(failed)
}

/// Exactly `expected` bytes.
fn decompress(bytes: &[u8], expected: usize) -> Result<Vec<u8>, CodeError> {
    let mut room = vec![0; expected];
    let failed =
        |e: ruzstd::decoding::errors::FrameDecoderError| CodeError::Compression { expected, reason: e.to_string() };
    let mut decoder = ruzstd::decoding::FrameDecoder::new();
    decoder.set_max_window_size(MOST_WINDOW_BYTES);
    let got = decoder.decode_all(bytes, &mut room).map_err(failed)?;
    if got == expected { Ok(room) } else { Err(CodeError::Length { expected, got }) }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP: f64 = 1.0 / 32768.0;

    /// A sheet of `side` × `side` vertices, 5 mm apart.
    fn sheet(side: u32) -> SurfaceCode {
        let at = |v: u32| [0.005 * (v % side) as f32, 0.005 * (v / side) as f32, 0.0];
        let cells = (0..side * side).filter(|v| v % side + 1 < side && v / side + 1 < side);
        let triangles: Vec<[u32; 3]> =
            cells.flat_map(|v| [[v, v + 1, v + side], [v + 1, v + side + 1, v + side]]).collect();
        SurfaceCode::new(&triangles, &(0..side * side).map(at).collect::<Vec<_>>(), STEP).unwrap()
    }

    fn decoded(code: &SurfaceCode, reference: &[GridPoint], parts: &[Vec<u8>]) -> Vec<GridPoint> {
        let mut now = vec![[77; 3]; code.vertices()];
        for (part, bytes) in parts.iter().enumerate().rev() {
            code.decode(part, reference, bytes, &mut now).unwrap();
        }
        now
    }

    fn encoded(code: &SurfaceCode, reference: &[GridPoint], now: &[GridPoint]) -> Vec<Vec<u8>> {
        (0..code.parts()).map(|part| code.encode(part, reference, now).unwrap()).collect()
    }

    #[test]
    fn a_surface_of_many_parts_comes_back_whatever_the_order_of_its_parts() {
        let code = sheet(110);
        assert_eq!((code.vertices(), code.parts()), (12_100, 3));
        let now: Vec<_> = code.rest().iter().map(|[x, y, z]| [x + y / 7, y - x / 5, z + x * y / 4096]).collect();
        let parts = encoded(&code, code.rest(), &now);
        assert_eq!(decoded(&code, code.rest(), &parts), now);
        let one = code.encode(3, code.rest(), &now).unwrap_err().to_string();
        assert_eq!(one, "part 3 of a surface in 3 parts");
        let levels: Vec<u8> = (0..12_100).map(|v| (v / 3000) as u8).collect();
        let mut back = vec![9; levels.len()];
        for part in [1, 0, 2] {
            let bytes = code.encode_levels(part, &levels).unwrap();
            assert!(bytes.len() < 60, "{} bytes", bytes.len());
            code.decode_levels(part, &bytes, &mut back).unwrap();
        }
        assert_eq!(back, levels);
    }

    #[test]
    fn what_has_not_moved_costs_next_to_nothing_and_noise_never_more_than_a_message_may() {
        let code = sheet(64);
        assert_eq!(code.vertices(), VERTICES_PER_PART);
        let still = code.encode(0, code.rest(), code.rest()).unwrap();
        assert!(still.len() < 40, "{} bytes for {} vertices at rest", still.len(), code.vertices());
        let mut random = 1u32;
        let mut noise = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random ^ (random >> 15)).wrapping_mul(0x9e37_79b1) as i32
        };
        let points: Vec<GridPoint> = (0..VERTICES_PER_PART).map(|_| [noise(), noise(), noise()]).collect();
        let levels: Vec<u8> = points.iter().map(|p| p[0] as u8).collect();
        let bytes = code.encode(0, code.rest(), &points).unwrap().len() + code.encode_levels(0, &levels).unwrap().len();
        assert!(bytes > 12 * VERTICES_PER_PART, "{bytes} bytes are noise");
        // Beside them are eight tools of less than 100 bytes each, and some numbers.
        assert!(bytes + 1000 < MOST_MESSAGE_BYTES, "{bytes} bytes");
    }

    #[test]
    fn bytes_that_unpack_to_more_than_a_part_are_refused_before_they_do() {
        let code = sheet(4);
        let bomb = zstd::bulk::compress(&vec![0; 100 << 20], 1).unwrap();
        let mut now = code.rest().to_vec();
        assert!(matches!(code.decode(0, code.rest(), &bomb, &mut now), Err(CodeError::Compression { .. })));
        let short = zstd::bulk::compress(&[0; 191], 1).unwrap();
        let refused = code.decode(0, code.rest(), &short, &mut now).unwrap_err();
        assert_eq!(refused, CodeError::Length { expected: 192, got: 191 });
        assert_eq!(now, code.rest());
    }

    #[test]
    fn a_grid_or_triangle_that_makes_no_sense_gives_no_code() {
        let rest = [[0.0; 3]; 3];
        assert!(SurfaceCode::new(&[[0, 1, 2]], &rest, STEP).is_some());
        assert!(SurfaceCode::new(&[[0, 1, 3]], &rest, STEP).is_none());
        for step in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(SurfaceCode::new(&[[0, 1, 2]], &rest, step).is_none(), "{step}");
        }
    }

    /// A surface of up to 40 vertices with any triangles.
    fn any_code() -> impl Strategy<Value = SurfaceCode> {
        (1u32..40).prop_flat_map(|n| {
            prop::collection::vec([0..n, 0..n, 0..n], 0..80)
                .prop_map(move |triangles| SurfaceCode::new(&triangles, &vec![[0.5; 3]; n as usize], STEP).unwrap())
        })
    }

    proptest! {
        #[test]
        fn whatever_is_coded_comes_back(
            code in any_code(),
            points in prop::collection::vec(any::<(GridPoint, GridPoint)>(), 40),
            levels in prop::collection::vec(any::<u8>(), 40),
        ) {
            let n = code.vertices();
            let (reference, now): (Vec<_>, Vec<_>) = points[..n].iter().copied().unzip();
            prop_assert_eq!(decoded(&code, &reference, &encoded(&code, &reference, &now)), now);
            let mut back = vec![0; n];
            code.decode_levels(0, &code.encode_levels(0, &levels[..n]).unwrap(), &mut back).unwrap();
            prop_assert_eq!(&back[..], &levels[..n]);
        }

        #[test]
        fn damaged_bytes_give_an_error_or_a_surface_and_never_a_panic(
            code in any_code(), bytes in prop::collection::vec(any::<u8>(), 0..300),
            at in any::<prop::sample::Index>(), byte in any::<u8>(), part in 0usize..3,
        ) {
            let mut now = code.rest().to_vec();
            if code.decode(part, code.rest(), &bytes, &mut now).is_err() {
                prop_assert_eq!(&now[..], code.rest());
            }
            let moved: Vec<_> = now.iter().map(|p| p.map(|x| x.wrapping_mul(3))).collect();
            let mut damaged = code.encode(0, code.rest(), &moved).unwrap();
            let at = at.index(damaged.len());
            damaged[at] = byte;
            let _ = code.decode(0, code.rest(), &damaged, &mut now);
            let _ = code.decode_levels(part, &bytes, &mut vec![0; code.vertices()]);
        }

        #[test]
        fn a_point_stands_at_most_half_a_step_from_where_it_was(x in prop::array::uniform3(-100.0..100.0f64)) {
            let code = sheet(2);
            let back = code.position(code.on_grid(x));
            for (x, back) in x.into_iter().zip(back) {
                // An f32 has 24 bits.
                prop_assert!((x - f64::from(back)).abs() <= 0.5 * STEP + x.abs() * 6e-8);
            }
        }
    }
}
