//! The visited set: indices that have been looked at, as in a walk over a mesh.

/// A set of indices; cleared in constant time, because each entry carries the generation it was put in.
#[derive(Clone, Debug)]
pub struct Visited {
    /// Count of the times that it has been emptied, and what that was when each was put in.
    turn: u32,
    last: Vec<u32>,
}

impl Visited {
    /// Room for the numbers below `count`, none of which is in it.
    pub fn new(count: usize) -> Self {
        Self { turn: 1, last: vec![0; count] }
    }

    /// Takes all out.
    pub fn clear(&mut self) {
        self.turn = self.turn.wrapping_add(1);
        if self.turn == 0 {
            self.last.fill(0);
            self.turn = 1;
        }
    }

    /// Puts `i` in; true unless it was there.
    #[inline]
    pub fn visit(&mut self, i: usize) -> bool {
        std::mem::replace(&mut self.last[i], self.turn) != self.turn
    }

    /// True when `i` is in it.
    #[inline]
    pub fn contains(&self, i: usize) -> bool {
        self.last[i] == self.turn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_in_before_is_not_in_after_however_often_it_was_emptied() {
        let mut set = Visited::new(2);
        assert!(set.visit(1) && !set.visit(1) && set.contains(1) && !set.contains(0));
        set.turn = u32::MAX - 1;
        set.last = vec![u32::MAX - 1, 1];
        assert!(set.contains(0) && !set.contains(1));
        for _ in 0..3 {
            set.clear();
            assert!(!set.contains(0) && !set.contains(1));
        }
    }
}
