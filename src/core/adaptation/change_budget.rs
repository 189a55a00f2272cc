//! The budget of one tick's changes of resolution.

use crate::model::active_set::Change;
use crate::model::{ActiveMesh, Body};
use crate::stepping::work;

/// Change units left in a tick: for one change, and for several together only where they take little.
pub(super) struct ChangeBudget {
    /// Change units that one may take, with what it adds to the tick.
    one: u32,
    /// And several together.
    several: u32,
    /// Whether their out-of-balance forces decay as residuals.
    residuals: bool,
    /// Whether loads near the changes are to be weighed exactly, and what of the units that takes.
    pub(super) weighs: bool,
    weighed: u32,
    taken: u32,
    refused: u32,
    /// Changes that take more than there is, after which no others are looked at.
    most_refused: u32,
    /// The one of them that takes the least, and its change units.
    pub(super) cheapest: Option<(u32, Change)>,
}

impl ChangeBudget {
    pub(super) fn new([one, several]: [u32; 2], residuals: bool, most_refused: u32) -> Self {
        Self { one, several, residuals, weighs: false, weighed: 0, taken: 0, refused: 0, most_refused, cheapest: None }
    }

    /// True where it is enough for `change`, too, which adds as much as `more` change units to the tick. Changes side by side take together what
    /// each takes alone, or less, but for the few elements that none of them alone takes out.
    pub(super) fn takes(&mut self, body: &Body, mesh: &mut ActiveMesh, change: Change, more: u32) -> bool {
        let weighing = if self.weighs { work::weighing_units(mesh.loads_near(body, &[change])) } else { 0 };
        let units = self.alone(body, mesh, change) + weighing + more;
        let (total, most) = match self.taken {
            0 => (units, self.one),
            taken => (taken + units - work::empty_batch_units(mesh), self.several),
        };
        let enough = total <= most;
        if !enough && self.cheapest.is_none_or(|(least, _)| units < least) {
            self.cheapest = Some((units, change));
        }
        *(if enough { &mut self.taken } else { &mut self.refused }) = if enough { total } else { self.refused + 1 };
        self.weighed += if enough { weighing } else { 0 };
        enough
    }

    /// Change units that `change` takes by itself.
    fn alone(&self, body: &Body, mesh: &mut ActiveMesh, change: Change) -> u32 {
        let cost = mesh.estimate(body, &[change], self.residuals);
        work::change_units(mesh, &cost)
    }

    /// True where it were enough for `change` alone, if that had just the `room` that it adds to the tick.
    pub(super) fn would_take(&mut self, body: &Body, mesh: &mut ActiveMesh, change: Change, room: u32) -> bool {
        let enough = self.alone(body, mesh, change) + room <= self.one;
        self.refused += u32::from(!enough);
        enough
    }

    /// Change units that are left beside what has been taken, but for weighing loads.
    pub(super) fn spare(&self) -> u32 {
        (self.one + self.weighed).saturating_sub(self.taken)
    }

    /// True where it is of no use to ask for more.
    pub(super) fn is_spent(&self) -> bool {
        self.refused >= if self.taken > 0 { 1 } else { self.most_refused }
    }
}
