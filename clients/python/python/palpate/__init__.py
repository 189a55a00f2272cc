"""Palpate: touch soft bodies in real time.

A simulation in this process, without a server::

    import numpy as np
    import palpate

    sim = palpate.Simulation("cube")
    sim.attach("ball")
    poses = np.linspace([0.05, 0.05, 0.125], [0.05, 0.05, 0.11], 1000)  # m, one a millisecond
    felt = sim.run(poses)
    print(felt.force[-1])                                               # N

A server, with a device or a viewer: :func:`connect`. Recordings as arrays: :func:`read_recording`. Bodies from mesh files:
:func:`prepare`.

Units are SI (m, kg, s, N, N·m), frames right-handed, quaternions x, y, z, w. One tick is a millisecond.
"""

from ._native import (
    Connection,
    Recording,
    Simulation,
    Tool,
    Watch,
    Wrench,
    Wrenches,
    connect,
    prepare,
    read_recording,
)

__all__ = [
    "Connection",
    "Phase",
    "Recording",
    "Simulation",
    "Tool",
    "Watch",
    "Wrench",
    "Wrenches",
    "WrenchFlag",
    "connect",
    "prepare",
    "read_recording",
]

import enum as _enum


class Phase(_enum.IntEnum):
    """Numbers in ``Wrenches.phase``: where a tool stands in its life."""

    DETACHED = 0
    """Nobody holds it, or its poses stopped; zero force."""
    WAITING = 1
    """Held, but it has not been outside the body yet; zero force."""
    ENGAGED = 2
    """Forces are rendered."""
    HOLDING = 3
    """Poses stopped: pose held, force ramping to zero."""


class WrenchFlag(_enum.IntFlag):
    """Bits of ``flags``: why the rendered force differs from the physical one."""

    CLAMPED = 1
    SLEW_LIMITED = 2
    RAMPING = 4
    SPEED_LIMITED = 8
    STATE_RESTORED = 16
    SUBSTEPS_DROPPED = 32
