"""Stubs of the compiled module. Units are SI, frames right-handed, quaternions x, y, z, w."""

import os
from typing import Any, Optional, Sequence, TypedDict, Union, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

Path = Union[str, "os.PathLike[str]"]
ToolName = Union[int, str]

class Wrench:
    """What a tool feels in one tick."""

    @property
    def tick(self) -> int:
        """Simulated time [ms]."""
    @property
    def position(self) -> NDArray[np.float64]:
        """(3) [m] of the simulated tool, which hangs back from the handle under force."""
    @property
    def orientation(self) -> NDArray[np.float64]:
        """(4) quaternion x, y, z, w of the simulated tool."""
    @property
    def force(self) -> NDArray[np.float64]:
        """(3) [N] on the tool, rendered: after clamp, slew limit and ramp."""
    @property
    def torque(self) -> NDArray[np.float64]:
        """(3) [N·m] about the tool's reference point, rendered."""
    @property
    def physical_force(self) -> NDArray[np.float64]:
        """(3) [N] on the tool, as the contact gives it."""
    @property
    def physical_torque(self) -> NDArray[np.float64]:
        """(3) [N·m] about the tool's reference point, as the contact gives it."""
    @property
    def opening(self) -> float:
        """How far the jaws of the simulated tool are open: 0, closed, to 1."""
    @property
    def grip_torque(self) -> float:
        """[N·m] What opens the jaws, for the angle between them, rendered."""
    @property
    def contact_points(self) -> int:
        """Contact points that carry force; 0: free."""
    @property
    def phase(self) -> str:
        """"detached", "waiting", "engaged" or "holding", see :class:`palpate.Phase`."""
    @property
    def flags(self) -> int:
        """Bits of :class:`palpate.WrenchFlag`."""

class Wrenches:
    """Wrenches of one tool, a row each."""

    def __len__(self) -> int: ...
    @property
    def tick(self) -> NDArray[np.uint64]:
        """(n) simulated time [ms]."""
    @property
    def time(self) -> NDArray[np.float64]:
        """(n) simulated time [s]."""
    @property
    def position(self) -> NDArray[np.float64]:
        """(n, 3) [m] of the simulated tool."""
    @property
    def orientation(self) -> NDArray[np.float64]:
        """(n, 4) quaternions x, y, z, w of the simulated tool."""
    @property
    def force(self) -> NDArray[np.float64]:
        """(n, 3) [N] on the tool, rendered: after clamp, slew limit and ramp."""
    @property
    def torque(self) -> NDArray[np.float64]:
        """(n, 3) [N·m] about the tool's reference point, rendered."""
    @property
    def physical_force(self) -> NDArray[np.float64]:
        """(n, 3) [N] on the tool, as the contact gives it."""
    @property
    def physical_torque(self) -> NDArray[np.float64]:
        """(n, 3) [N·m] about the tool's reference point, as the contact gives it."""
    @property
    def opening(self) -> NDArray[np.float64]:
        """(n) how far the jaws of the simulated tool are open: 0, closed, to 1."""
    @property
    def grip_torque(self) -> NDArray[np.float64]:
        """(n) [N·m] what opens the jaws, for the angle between them, rendered."""
    @property
    def contact_points(self) -> NDArray[np.uint32]:
        """(n) contact points that carry force."""
    @property
    def phase(self) -> NDArray[np.uint8]:
        """(n) values of :class:`palpate.Phase`."""
    @property
    def flags(self) -> NDArray[np.uint32]:
        """(n) bits of :class:`palpate.WrenchFlag`."""

class Simulation:
    """A body under way in this process, bit for bit as ``palpate simulate`` runs it.

    ``scene`` is a scene file, a prepared body (``.palpate``) or a bundled scene ("liver", "organs", "toy", "cube", "grasp", "squeeze", "laparoscopy").
    Keywords override its keys: ``Simulation("liver", material={"youngs_modulus": 8000})``, or
    ``Simulation("liver", **{"material.youngs_modulus": 8000})``.

    Building a body takes from below a second to a minute. Poses are (3) positions [m], or (7) with a quaternion. Raises
    ``ValueError`` with file, line and remedy where the scene is wrong, or starts unfit to be touched.
    """

    def __new__(cls, scene: Path = "liver", /, **overrides: Any) -> "Simulation": ...
    def attach(
        self,
        tool: ToolName = 0,
        *,
        rate_hz: float = 1000.0,
        coupling_stiffness: float = 0.0,
        coupling_angular_stiffness: float = 0.0,
    ) -> int:
        """Takes a tool, by number or name, and returns its number. Takes one tick.

        ``rate_hz`` is how often poses will come; slower poses are followed evenly. ``coupling_stiffness`` [N/m] and
        ``coupling_angular_stiffness`` [N·m/rad] are those of the virtual coupling; 0 holds the tool rigidly.
        """
    def detach(self, tool: ToolName = 0) -> None:
        """Lets a tool go. Takes one tick."""
    def set_parameters(self, parameters: "dict[str, Union[float, Sequence[float]]]") -> None:
        """Sets parameters, each in a tick of its own: ``{"stiffness.nodule": 2.0, "gravity": [0, 0, -9.81]}``.

        Names: "gravity" [m/s²], "damping" (part of the scene's), "stiffness.TISSUE" (factor on what the scene gives),
        "friction.TOOL", "shape.TOOL" (the tool whose shape it has); "stiffness", "friction" and "shape" alone mean all. Raises
        ``ValueError`` with the name and the range of one that is refused, and sets none then.
        """
    def step(self, pose: Optional[ArrayLike] = None, tool: ToolName = 0) -> Wrench:
        """One tick (1 ms), in which the tool gets a new pose, or nothing happens; the wrench after it."""
    @overload
    def run(self, poses: ArrayLike, tool: ToolName = 0) -> Wrenches:
        """One tick for each row of ``poses``, (n, 3), (n, 7) or, of a tool with jaws, (n, 8). Python's lock is free meanwhile."""
    @overload
    def run(self, poses: "dict[ToolName, ArrayLike]") -> "dict[ToolName, Wrenches]":
        """Several tools at once, each with as many poses."""
    def record(self, path: Path, poses: ArrayLike, tool: ToolName = 0) -> Wrenches:
        """As :meth:`run`, and writes a recording (MCAP) that ``palpate replay`` runs again and ``palpate view`` shows."""
    def vertices(self) -> NDArray[np.float64]:
        """(n, 3) [m] vertices of the surface now."""
    def levels(self) -> NDArray[np.uint8]:
        """(n) level of detail that displays each vertex, 0 the coarsest."""
    @property
    def triangles(self) -> NDArray[np.uint32]:
        """(m, 3) vertex numbers, counter-clockwise seen from outside."""
    @property
    def rest_vertices(self) -> NDArray[np.float64]:
        """(n, 3) [m] vertices of the surface at rest."""
    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) [m] least and greatest coordinates of the surface at rest."""
    def snapshot(self) -> bytes:
        """Everything that the next tick depends on beside its inputs."""
    def restore(self, snapshot: bytes) -> None:
        """Goes back to a snapshot of this body: the same poses give the same bits again."""
    @property
    def hash(self) -> int:
        """64 bits of the whole state: the same for the same history, on any x86-64 machine."""
    @property
    def tick(self) -> int:
        """Ticks since the start."""
    @property
    def time(self) -> float:
        """Simulated time [s]."""
    @property
    def tools(self) -> "list[str]":
        """Names of the tools."""
    @property
    def attached(self) -> "list[bool]":
        """Which of them are attached."""
    @property
    def name(self) -> str:
        """Name of the body."""
    @property
    def mass(self) -> float:
        """Mass of the body [kg]."""
    @property
    def active_nodes(self) -> int:
        """Nodes that are simulated now, of all levels."""
    @property
    def elements(self) -> int:
        """Elements that are simulated now."""
    @property
    def scene(self) -> str:
        """The scene (TOML), every default written out."""

def prepare(
    inputs: Union[Path, Sequence[Path]],
    out: Path,
    *,
    unit: str,
    scale: float = 1.0,
    finest: Optional[float] = None,
    levels: Sequence[float] = (),
    largest: bool = False,
    scene: Path = "organ",
    **overrides: Any,
) -> str:
    """Makes a body from a closed surface or tetrahedral meshes, writes it to ``out`` (``.palpate``) and returns a report.

    ``unit`` is "m", "cm", "mm" or "in". ``finest`` [m] is the lattice constant of the finest level, ``levels`` [m] those of
    all levels, coarse to fine; by default there are four, by volume. ``largest`` takes the largest of several bodies in a
    file. Material and holds are those of ``scene`` with ``overrides``, as for :class:`Simulation`.
    """

def connect(
    force: Optional[str] = None,
    surface: Optional[str] = None,
    session: Optional[str] = None,
    *,
    identity: Optional[Path] = None,
    watch_only: bool = False,
) -> "Connection":
    """Connects to a server: zenoh endpoints such as "tcp/192.168.0.2:7447"; by default one on this machine.

    ``identity`` is the folder of this client's certificate, where the server asks for one. ``watch_only`` opens no force channel. Raises ``ConnectionError``, after 5 s for each endpoint at most.
    """

class Connection:
    """An open connection."""

    def session(self) -> "dict[str, Any]":
        """What the server simulates: name, version, tick, body, mass [kg], bounds and workspace [m], force_limit [N],
        torque_limit [N·m], tools with name, shape, radius [m] and taken, names of obstacles, and parameters that may be set, each
        with its values, the least and the most."""
    def set_parameters(self, parameters: "dict[str, Union[float, Sequence[float]]]") -> None:
        """Sets parameters of the running simulation, all of them or none: ``{"stiffness.nodule": 2.0, "gravity": [0, 0, -9.81]}``.

        ``session()["parameters"]`` has their names and ranges. Raises ``ConnectionError`` with the name and the range of one that is
        refused.
        """
    def attach(
        self,
        tool: str = "",
        *,
        device: str = "PHANTOM Omni",
        frame: str = "palpate",
        render: str = "local-passive",
        rate_hz: float = 1000.0,
        client: str = "python",
        scale: float = 1.0,
        rotation: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
        translation: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> "Tool":
        """Takes a tool, by name or any free one, and starts a force loop on a thread of its own, ``rate_hz`` times a second.

        ``device`` ("Touch", "omega", …, or a TOML file) limits force and coupling. ``frame`` gives axes and unit of poses
        and forces ("palpate", "openxr", "unity", "unreal", "ros", "phantom", "haply"); scale, rotation and translation [m]
        place the device in the body. ``render`` is "raw", "passive", "local" or "local-passive".
        """
    def watch(self, every: int = 1, levels: bool = False) -> "Watch":
        """Watches the surface: every frame (1), second (2), fourth (4) or eighth (8) of 31.25 a second."""

class ToolState(TypedDict):
    hold: str
    """"held"; "fading": wrenches have stopped; "refused": the server takes none of the poses; "gone": attach again."""
    phase: str
    flags: int
    age: float
    """Age of the newest wrench [s]."""
    contact_points: int

class Tool:
    """A tool in the hand. Calls raise ``ConnectionError`` once it is gone. As a context manager it gives itself back."""

    def move(self, pose: ArrayLike, velocity: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        """Where the device is from now on, in its frame, and how fast (unit of the frame per second): the loop sends it."""
    def follow(self, poses: ArrayLike) -> Wrenches:
        """Sends a row of ``poses`` each period and returns what was felt at each: force and torque are those that the
        device would render, in its frame; the rest is the newest wrench."""
    @property
    def force(self) -> NDArray[np.float64]:
        """(3) [N] to give now, in the device's frame. Zero 70 ms after wrenches have stopped."""
    @property
    def torque(self) -> NDArray[np.float64]:
        """(3) [N·m] to give now, in the device's frame."""
    @property
    def wrench(self) -> Optional[Wrench]:
        """The newest wrench, in the world frame; ``None`` before the first."""
    @property
    def state(self) -> ToolState:
        """How the tool is doing; does not raise when it is gone."""
    @property
    def id(self) -> int:
        """Number of the tool in the session."""
    def detach(self) -> None:
        """Gives the tool back and ends the loop."""
    def __enter__(self) -> "Tool": ...
    def __exit__(self, *args: object) -> None: ...

class Watch:
    """A running view of the surface."""

    @property
    def triangles(self) -> NDArray[np.uint32]:
        """(m, 3) vertex numbers."""
    @property
    def rest_vertices(self) -> NDArray[np.float32]:
        """(n, 3) [m] at rest."""
    def latest(self) -> "Optional[dict[str, Any]]":
        """The newest frame: tick, sequence, topology, vertices (n, 3) [m], levels (n, or 0), tools with position,
        orientation, force [N] and phase, and obstacles with position and the force on each [N]; ``None`` before the first."""
    @property
    def counters(self) -> "dict[str, int]":
        """Frames decoded and lost, undecodable messages, bytes."""

def read_recording(path: Path) -> "Recording":
    """Reads a recording (MCAP). Raises ``OSError`` when it is none. One cut short gives what is whole."""

class Recording:
    """A recording in memory."""

    @property
    def tools(self) -> "list[str]":
        """Names of the tools."""
    @property
    def scene(self) -> str:
        """The scene (TOML)."""
    @property
    def ticks(self) -> NDArray[np.uint64]:
        """(n) simulated time of every recorded tick [ms]."""
    @property
    def cut(self) -> Optional[str]:
        """Why reading ended before the end of the file, when it did."""
    def wrenches(self, tool: int = 0) -> Wrenches:
        """Wrenches of a tool while it was held."""
    def poses(self, tool: int = 0) -> "tuple[NDArray[np.uint64], NDArray[np.float64]]":
        """Ticks (n) and poses (n, 7): position [m] and quaternion, as the client sent them."""
    def hashes(self) -> "tuple[NDArray[np.uint64], NDArray[np.uint64]]":
        """Ticks and hashes of the state at frames."""
    @property
    def triangles(self) -> NDArray[np.uint32]:
        """(m, 3) vertex numbers."""
    def vertices(self, every: int = 1) -> "tuple[NDArray[np.uint64], list[NDArray[np.float32]]]":
        """Ticks, and the surface (vertices, 3) [m] of each: every frame, or every second, third …"""
