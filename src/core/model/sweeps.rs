//! Loops that are compiled twice: for any CPU, and with AVX2 registers, which hold one [`Padded`]. Those over nodes and interface rows
//! are here.
//!
//! Both are the same source. Neither fuses a multiply with an add, and each sum has one order, so both give the same bits.

use super::interface::InterfaceRow;
use super::lanes::Padded;
use crate::ids::Slot;
use crate::math::Real;

/// Registers that a sweep may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Registers {
    /// Those of any CPU.
    Any,
    /// AVX2.
    Avx2,
}

impl Registers {
    /// The widest of this CPU.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Any
    }
}

macro_rules! sweep {
    ($(#[$meta:meta])* $visibility:vis fn $name:ident($($argument:ident: $kind:ty),* $(,)?) $body:block) => {
        $(#[$meta])*
        $visibility fn $name(registers: $crate::model::sweeps::Registers, $($argument: $kind),*) {
            #[inline(always)]
            fn with_any($($argument: $kind),*) $body
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            fn with_avx2($($argument: $kind),*) {
                with_any($($argument),*);
            }
            match registers {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: only `Registers::best` names them, where the CPU has them.
                $crate::model::sweeps::Registers::Avx2 => unsafe { with_avx2($($argument),*) },
                _ => with_any($($argument),*),
            }
        }
    };
}

pub(crate) use sweep;

sweep! {
    /// Places the interface nodes in `slots` where the rows' masters say: `x_i = Σ_j P_ij x_j`.
    pub fn place(rows: &[InterfaceRow<Slot>], slots: &[Slot], position: &mut [Padded]) {
        for &slot in slots {
            let mut sum = [0.0; 4];
            for (master, weight) in rows[slot.index()].entries() {
                let x = &position[master.index()];
                for c in 0..4 {
                    sum[c] += weight * x[c];
                }
            }
            position[slot.index()] = sum;
        }
    }
}

sweep! {
    /// Hands the forces on the interface nodes in `slots` to their masters: `f_j += P_ij f_i`, and `f_i = 0`.
    pub fn hand_back(rows: &[InterfaceRow<Slot>], slots: &[Slot], force: &mut [Padded]) {
        for &slot in slots {
            let f = std::mem::replace(&mut force[slot.index()], [0.0; 4]);
            if f == [0.0; 4] {
                continue;
            }
            for (master, weight) in rows[slot.index()].entries() {
                let to = &mut force[master.index()];
                for c in 0..4 {
                    to[c] += weight * f[c];
                }
            }
        }
    }
}

/// What free fall moves.
pub struct Falling<'a> {
    /// World positions [m], by slot.
    pub position: &'a mut [Padded],
    /// Velocities [m/s], by slot.
    pub velocity: &'a mut [Padded],
    /// [1/kg], by slot; nodes with none never had a velocity, and do not fall.
    pub inverse_mass: &'a [Real],
    /// Time of each slot's position [s] since the start of the tick.
    pub time: &'a mut [Real],
}

sweep! {
    /// Free fall of the nodes in `slots` up to `now` [s] in the field `gravity` [m/s²].
    pub fn fall(slots: &[Slot], falling: Falling, gravity: Padded, now: Real) {
        let Falling { position, velocity, inverse_mass, time } = falling;
        for &slot in slots {
            let s = slot.index();
            let step = now - std::mem::replace(&mut time[s], now);
            if inverse_mass[s] > 0.0 {
                let (x, v) = (&mut position[s], &mut velocity[s]);
                for c in 0..4 {
                    x[c] += step * (v[c] + 0.5 * step * gravity[c]);
                    v[c] += step * gravity[c];
                }
            }
        }
    }
}

sweep! {
    /// Gives the nodes in `slots` the impulse of their forces over `step` [s], and sets these to zero.
    pub fn kick(slots: &[Slot], inverse_mass: &[Real], step: Real, force: &mut [Padded], velocity: &mut [Padded]) {
        for &slot in slots {
            let s = slot.index();
            let f = std::mem::replace(&mut force[s], [0.0; 4]);
            let impulse = step * inverse_mass[s];
            let v = &mut velocity[s];
            for c in 0..4 {
                v[c] += impulse * f[c];
            }
        }
    }
}

sweep! {
    /// Raises `squares` to those of how far any node in `slots` is from where it was `before`, along each axis [m²].
    pub fn farthest(slots: &[Slot], position: &[Padded], before: &[Padded], squares: &mut Padded) {
        let mut most = *squares;
        for &slot in slots {
            let (now, then) = (&position[slot.index()], &before[slot.index()]);
            for c in 0..4 {
                let way = now[c] - then[c];
                most[c] = if way * way > most[c] { way * way } else { most[c] };
            }
        }
        *squares = most;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_registers_give_the_same_bits() {
        let number = |i: usize, c: usize| (2.0 + i as Real - 3.1 * c as Real).abs().sqrt() - 1.3;
        let run = |registers: Registers| {
            let slots: Vec<Slot> = (0..40).map(Slot).collect();
            let mut field: [Vec<Padded>; 3] =
                [0, 1, 2].map(|k| (0..40).map(|i| [0, 1, 2, 3].map(|c| number(7 * i + k, c))).collect());
            let inverse_mass: Vec<Real> = (0..40).map(|i| if i % 9 == 0 { 0.0 } else { number(i, 0).abs() }).collect();
            let mut time = vec![0.1; 40];
            let [position, velocity, force] = &mut field;
            let falling = Falling { position, velocity, inverse_mass: &inverse_mass, time: &mut time };
            fall(registers, &slots, falling, [0.1, -0.2, -9.81, 0.0], 0.37);
            kick(registers, &slots, &inverse_mass, 0.013, force, velocity);
            let mut far = [0.0; 4];
            farthest(registers, &slots, &field[0], &field[1], &mut far);
            (field, time, far)
        };
        assert_eq!(run(Registers::Any), run(Registers::best()));
    }
}
