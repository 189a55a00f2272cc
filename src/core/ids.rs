//! Ids, a type for each kind, so that none is taken for another.

use serde::{Deserialize, Serialize};

/// Stands for "no node", "no element" and the like in lists where an `Option` would take twice the room.
pub const NONE: u32 = u32::MAX;

/// An id, of whatever kind.
pub trait Id: Copy + Eq {
    /// Stands for none.
    const NONE: Self;
    /// The number as one of a place in a list.
    fn index(self) -> usize;
    /// Of the thing in this place of a list.
    fn at(index: usize) -> Self;
}

macro_rules! id {
    ($(#[$meta:meta])* $name:ident) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[serde(transparent)]
        #[repr(transparent)]
        pub struct $name(pub u32);

        impl $name {
            /// Stands for none where an `Option` would take twice the room.
            pub const NONE: Self = Self(NONE);

            /// The number as one of a place in a list.
            #[inline(always)]
            pub const fn index(self) -> usize {
                self.0 as usize
            }

            /// Of the thing in this place of a list.
            #[inline(always)]
            pub const fn at(index: usize) -> Self {
                Self(index as u32)
            }
        }

        impl Id for $name {
            const NONE: Self = Self::NONE;

            #[inline(always)]
            fn index(self) -> usize {
                self.index()
            }

            #[inline(always)]
            fn at(index: usize) -> Self {
                Self::at(index)
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                self.0.fmt(f)
            }
        }
    };
}

id! {
    /// Place of a node among those that move, active and interface nodes alike: another node's once it is free.
    Slot
}

id! {
    /// A node of a body, numbered through all levels. A level by itself counts its own from 0, as plain numbers.
    Node
}

id! {
    /// An element of a body, numbered through all levels. A level by itself counts its own from 0, as plain numbers.
    Element
}

id! {
    /// A vertex of a body's display surface. A surface by itself has plain numbers.
    Vertex
}

id! {
    /// A triangle of a body's display surface. A surface by itself has plain numbers.
    Triangle
}

id! {
    /// An organ of a body: its place in [`Body::organs`](crate::model::Body::organs).
    OrganId
}

id! {
    /// A tool of a session: its place in [`Settings::tools`](crate::simulation::Settings::tools).
    ToolId
}
