//! What the surface looks like: materials and pictures, as a server of 1.4 has them.

use palpate_proto::{SurfaceMaterial, SurfacePicture};

use crate::ClientError;

/// What triangles look like.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// A name for people.
    pub name: String,
    /// How many triangles are of it.
    pub triangles: usize,
    /// Red, green and blue, linear, 0 to 1: a factor on the picture where there is one; `None`: as the viewer likes.
    pub colour: Option<[f32; 3]>,
    /// Number of its picture, from 1.
    pub picture: Option<u32>,
}

impl Material {
    /// Those of a surface with `triangles`; `None` when they are of another number.
    pub(super) fn all(messages: Vec<SurfaceMaterial>, triangles: usize) -> Option<Vec<Self>> {
        let material = |message: SurfaceMaterial| Self {
            name: message.name,
            triangles: message.triangles as usize,
            colour: message.colour.as_slice().try_into().ok(),
            picture: Some(message.picture).filter(|picture| *picture > 0),
        };
        let all: Vec<Self> = messages.into_iter().map(material).collect();
        let sum = all.iter().fold(0usize, |sum, material| sum.saturating_add(material.triangles));
        (all.is_empty() || sum == triangles).then_some(all)
    }
}

/// A picture on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Its number, from 1.
    pub number: u32,
    /// `image/png` or `image/jpeg`.
    pub media_type: String,
    /// The file's bytes.
    pub bytes: Vec<u8>,
}

impl Picture {
    /// The pictures on the surface `topology` that came in `parts`, in any order. Errors: [`ClientError::Undecodable`] when
    /// some parts are missing.
    pub fn from_parts(mut parts: Vec<SurfacePicture>, topology: u32) -> Result<Vec<Self>, ClientError> {
        parts.retain(|part| part.topology == topology);
        parts.sort_by_key(|part| (part.picture, part.part));
        let mut pictures: Vec<Self> = Vec::new();
        for of_one in parts.chunk_by(|a, b| a.picture == b.picture) {
            let number = of_one[0].picture;
            let came: Vec<u32> = of_one.iter().map(|part| part.part).collect();
            if !came.iter().copied().eq(0..of_one[0].parts) {
                let reason = format!("parts {came:?} of {} of picture {number} came", of_one[0].parts);
                return Err(ClientError::Undecodable { message: "SurfacePicture", reason });
            }
            let bytes = of_one.iter().flat_map(|part| part.content.iter().copied()).collect();
            pictures.push(Self { number, media_type: of_one[0].media_type.clone(), bytes });
        }
        Ok(pictures)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(picture: u32, part: u32, content: &[u8]) -> SurfacePicture {
        let media_type = "image/png".into();
        SurfacePicture { topology: 4, picture, media_type, content: content.into(), part, parts: 2 }
    }

    #[test]
    fn pictures_are_whole_in_whatever_order_their_parts_come() {
        let parts = vec![part(2, 1, b"d"), part(1, 0, b"a"), part(2, 0, b"c"), part(1, 1, b"b")];
        let pictures = Picture::from_parts(parts.clone(), 4).unwrap();
        let told: Vec<_> = pictures.iter().map(|p| (p.number, p.bytes.as_slice())).collect();
        assert_eq!(told, [(1, &b"ab"[..]), (2, b"cd")]);
        let e = Picture::from_parts(parts[1..].to_vec(), 4).unwrap_err().to_string();
        assert!(e.contains("parts [0] of 2 of picture 2"), "{e}");
        assert_eq!(Picture::from_parts(parts, 5).unwrap(), []);
    }

    #[test]
    fn materials_are_of_as_many_triangles_as_the_surface_has() {
        let message = |triangles, colour: &[f32], picture| SurfaceMaterial {
            name: "skin".into(),
            triangles,
            colour: colour.into(),
            picture,
        };
        let messages = vec![message(3, &[1.0, 0.5, 0.0], 1), message(u32::MAX, &[], 0)];
        assert_eq!(Material::all(messages.clone(), 2), None);
        let all = Material::all(messages, 3 + u32::MAX as usize).unwrap();
        assert_eq!((all[0].colour, all[0].picture), (Some([1.0, 0.5, 0.0]), Some(1)));
        assert_eq!((all[1].colour, all[1].picture), (None, None));
        assert_eq!(Material::all(vec![], 7), Some(vec![]));
    }
}
