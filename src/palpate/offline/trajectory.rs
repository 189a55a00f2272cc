//! Trajectories: what happens to each tool, tick by tick, as a table that people and programs write.

mod numbered;

use crate::output::Output;
use numbered::{numbered, numbered_name};
use palpate_core::contact::tool::{Coupling, MOST_TOOLS, Phase, PoseSample, ToolEvent, ToolState};
use palpate_core::math::{Pose, Real, Vec3, normalized_quaternion};
use palpate_core::simulation::{Budget, Inputs, Parameter, Prices, Snapshot, TICK};
use std::io;
use std::path::Path;

/// Events of tools over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Tick (from 1), tool, event; ascending by tick, at most one per tool and tick.
    events: Vec<(u64, usize, ToolEvent)>,
    /// Ticks that begin with a reset of the body, ascending.
    resets: Vec<u64>,
    /// Parameters that are set, by tick, ascending, at most one a tick.
    parameters: Vec<(u64, Parameter)>,
    /// Budgets of the machine that it was recorded on, and new prices of work: each from a tick on, ascending.
    budgets: Vec<(u64, Budget, Option<Prices>)>,
}

/// Why a trajectory cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{origin}, line {line}: {what}")]
pub struct TrajectoryError {
    /// The file.
    pub origin: String,
    /// Line, from 1.
    pub line: usize,
    /// What is wrong, and what is expected.
    pub what: String,
}

/// First line of a trajectory of poses alone.
pub const TRAJECTORY_HEADER: &str = "time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw,buttons";
/// A column that may stand after those: how far the tool's jaws are to be open, 0 to 1; left out: closed.
pub const OPENING_COLUMN: &str = "opening";
/// What the first line goes on with where rows say what happens: a pose, an attachment with the period of its poses and the
/// compliances of its virtual coupling, a detachment or a reset of the body.
pub const EVENT_COLUMNS: &str = "event,period_s,coupling_m_per_N,angular_coupling_rad_per_Nm";

/// And after those, where rows say the budget of a machine: four times, and what each part of a tick costs, separated by spaces.
pub const BUDGET_COLUMNS: &str = "budget_ns,prices_ps";

/// And after those, where rows set parameters: `gravity`, `damping`, `supports`, `resolution.split` and so on, `stiffness.N` of the tissue or `friction.N` of the
/// tool of that number, and its values, separated by spaces.
pub const PARAMETER_COLUMNS: &str = "parameter,values";

/// Places of columns.
const POSITION: usize = 2;
const ORIENTATION: usize = 5;
const BUTTONS: usize = 9;
const EVENT: usize = 10;
const PERIOD: usize = 11;
const COUPLING: usize = 12;
const ANGULAR_COUPLING: usize = 13;
const BUDGET: usize = 14;
const PRICES: usize = 15;
const PARAMETER: usize = 16;
const VALUES: usize = 17;

/// Place of the column of openings, which moves those behind it.
const OPENING: usize = EVENT;

/// Longest period of poses [s]: that of a client that sends one in ten seconds.
const LONGEST_PERIOD: Real = 10.0;

impl Trajectory {
    /// Reads a trajectory: CSV with the columns of [`TRAJECTORY_HEADER`], or those and [`EVENT_COLUMNS`], or those and
    /// [`BUDGET_COLUMNS`], or those and [`PARAMETER_COLUMNS`], with a column `opening` after those of a pose or without; times ascend from 0, and a row of time `t` acts in the first tick that ends later.
    ///
    /// With poses alone each tool is attached just before its first pose, rigidly, with the median time between its rows as
    /// its period.
    ///
    /// # Errors
    /// With file, line and what is expected. `tools` is how many the scene has.
    pub fn parse(text: &str, origin: &str, tools: usize) -> Result<Self, TrajectoryError> {
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let mut records = reader.records().filter(|r| !r.as_ref().is_ok_and(|record| record.iter().all(str::is_empty)));
        // The reader counts lines from where it stood before it passed over empty ones.
        let line_of = |position: Option<&csv::Position>| {
            let at = position.map_or(0, |p| p.byte() as usize).min(text.len());
            let blank = text[at..].len() - text[at..].trim_start_matches(['\r', '\n']).len();
            text[..at + blank].matches('\n').count() + 1
        };
        let fault_at = |line: usize, what: String| TrajectoryError { origin: origin.to_owned(), line, what };
        let all_columns = format!("{TRAJECTORY_HEADER},{EVENT_COLUMNS},{BUDGET_COLUMNS},{PARAMETER_COLUMNS}");
        let names: Vec<&str> = all_columns.split(',').collect();
        let (header, jaws) = without_opening(&records.next().and_then(Result::ok).unwrap_or_default());
        let columns =
            [names.len(), PARAMETER, BUDGET, EVENT].into_iter().find(|n| header == names[..*n]).unwrap_or(EVENT);
        if header != names[..columns] {
            let expected =
                format!("the first line must be \"{TRAJECTORY_HEADER}\", or go on with \",{EVENT_COLUMNS}\"");
            return Err(fault_at(line_of(header.position()), expected));
        }
        let mut rows: Vec<(u64, Option<usize>, Row)> = Vec::new();
        let mut attached = [columns == EVENT; MOST_TOOLS];
        for record in records {
            let record = record.map_err(|e| fault_at(line_of(e.position()), e.to_string()))?;
            let fault = |what: String| fault_at(line_of(record.position()), what);
            let mut fields: Vec<&str> = record.iter().collect();
            let opening = (jaws && fields.len() > OPENING).then(|| fields.remove(OPENING));
            let cells = Cells { fields, opening, names: &names[..columns] };
            let (tick, tool, row) = cells.row(tools).map_err(fault)?;
            if rows.last().is_some_and(|last| last.0 > tick) {
                return Err(fault("times must ascend".into()));
            }
            if let Some(tool) = tool {
                let earlier = rows.iter().rev().take_while(|r| r.0 == tick).find(|r| r.1 == Some(tool));
                let both_pose = |(.., before): &(u64, Option<usize>, Row)| before.is_pose() && row.is_pose();
                if earlier.is_some_and(|earlier| !both_pose(earlier)) {
                    return Err(fault(format!("tool {tool} has another event in the same millisecond: move one")));
                }
                match row {
                    Row::Pose(_) if !attached[tool] => {
                        return Err(fault(format!(
                            "tool {tool} is not attached: a row \"attach\" comes before its poses"
                        )));
                    }
                    Row::Attach { .. } => attached[tool] = true,
                    Row::Detach => attached[tool] = false,
                    Row::Pose(_) | Row::Reset | Row::Budget(..) | Row::Set(_) => {}
                }
            }
            let mut same_tick = rows.iter().rev().take_while(|r| r.0 == tick);
            if matches!(row, Row::Set(_)) && same_tick.any(|r| matches!(r.2, Row::Set(_))) {
                return Err(fault("another parameter is set in the same millisecond: move one".into()));
            }
            rows.push((tick, tool, row));
        }
        Ok(if columns == EVENT { Self::of_poses(rows) } else { Self::of_rows(rows) })
    }

    /// Of poses alone: each tool is attached one tick before its first, so that all of them act one tick later.
    fn of_poses(rows: Vec<(u64, Option<usize>, Row)>) -> Self {
        let mut all = Vec::new();
        for tool in 0..MOST_TOOLS {
            let mut mine: Vec<_> = rows.iter().filter(|row| row.1 == Some(tool)).cloned().collect();
            keep_newest(&mut mine);
            let Some(first) = mine.first() else { continue };
            let mut gaps: Vec<u64> = mine.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
            gaps.sort_unstable();
            let period_ticks = gaps.get(gaps.len() / 2).copied().unwrap_or(1) as u32;
            all.push((first.0, Some(tool), Row::Attach { period_ticks, coupling: Coupling::RIGID }));
            all.extend(mine.into_iter().map(|(tick, tool, row)| (tick + 1, tool, row)));
        }
        all.sort_by_key(|row| (row.0, row.1));
        Self::of_rows(all)
    }

    /// Numbers attachments and poses.
    fn of_rows(mut rows: Vec<(u64, Option<usize>, Row)>) -> Self {
        rows.sort_by_key(|row| (row.0, row.1));
        keep_newest(&mut rows);
        let mut trajectory = Self::default();
        let (mut epoch, mut sequence) = ([0; MOST_TOOLS], [0; MOST_TOOLS]);
        for (tick, tool, row) in rows {
            let Some(tool) = tool else {
                match row {
                    Row::Budget(budget, prices) => trajectory.budgets.push((tick, budget, prices)),
                    Row::Set(parameter) => trajectory.parameters.push((tick, parameter)),
                    _ => trajectory.resets.push(tick),
                }
                continue;
            };
            let event = match row {
                Row::Attach { period_ticks, coupling } => {
                    epoch[tool] += 1;
                    sequence[tool] = 0;
                    ToolEvent::Attach { epoch: epoch[tool], period_ticks, coupling }
                }
                Row::Detach | Row::Reset | Row::Budget(..) | Row::Set(_) => ToolEvent::Detach,
                Row::Pose(sample) => {
                    sequence[tool] += 1;
                    ToolEvent::Pose(PoseSample { sequence: sequence[tool], ..sample })
                }
            };
            trajectory.events.push((tick, tool, event));
        }
        trajectory
    }

    /// What happened in a recording that began with `start`, and consumed `inputs`, by tick. Tools that somebody held at its
    /// beginning are attached anew, and parameters that had been set are set, and everything is so many ticks later.
    pub fn recorded(start: &Snapshot, inputs: &[(u64, Inputs)]) -> Self {
        let held: Vec<_> = start.tools.iter().enumerate().filter(|(_, tool)| tool.phase != Phase::Detached).collect();
        let later = u64::from(!held.is_empty()).max(start.parameters.len() as u64);
        let attach = |(tool, state): (usize, &ToolState)| {
            let (epoch, period_ticks, coupling) = (state.epoch, state.period_ticks, state.coupling);
            (1, tool, ToolEvent::Attach { epoch, period_ticks, coupling })
        };
        let mut trajectory = Self {
            events: held.into_iter().map(attach).collect(),
            parameters: (1..).zip(start.parameters.iter().copied()).collect(),
            ..Self::default()
        };
        let mut before = Budget::UNLIMITED;
        for (tick, inputs) in inputs {
            let tick = tick - start.tick + later;
            let events = inputs.tools.iter().enumerate();
            trajectory.events.extend(events.filter_map(|(tool, event)| event.map(|event| (tick, tool, event))));
            trajectory.resets.extend(inputs.reset.then_some(tick));
            trajectory.parameters.extend(inputs.parameter.map(|parameter| (tick, parameter)));
            if inputs.budget != before || inputs.prices.is_some() {
                before = inputs.budget;
                trajectory.budgets.push((tick, before, inputs.prices));
            }
        }
        trajectory
    }

    /// The inputs of tick `tick` (from 1).
    pub fn inputs(&self, tick: u64) -> Inputs {
        let mut inputs = Inputs { reset: self.resets.binary_search(&tick).is_ok(), ..Inputs::default() };
        let set = self.parameters.binary_search_by_key(&tick, |set| set.0);
        inputs.parameter = set.ok().map(|at| self.parameters[at].1);
        let now = self.budgets.partition_point(|budget| budget.0 <= tick).checked_sub(1);
        if let Some((from, budget, prices)) = now.map(|now| &self.budgets[now]) {
            (inputs.budget, inputs.prices) = (*budget, prices.filter(|_| *from == tick));
        }
        let first = self.events.partition_point(|e| e.0 < tick);
        for (_, tool, event) in self.events[first..].iter().take_while(|e| e.0 == tick) {
            inputs.tools[*tool] = Some(*event);
        }
        inputs
    }

    /// Last tick in which something happens.
    pub fn last_tick(&self) -> u64 {
        let event = self.events.last().map_or(0, |e| e.0).max(self.parameters.last().map_or(0, |set| set.0));
        self.resets.last().map_or(event, |reset| event.max(*reset))
    }

    /// Parameters that it sets, with their ticks.
    pub fn parameters(&self) -> &[(u64, Parameter)] {
        &self.parameters
    }

    /// Writes it as [`Trajectory::parse`] reads it, with [`EVENT_COLUMNS`], [`BUDGET_COLUMNS`] where it has budgets, and both and
    /// [`PARAMETER_COLUMNS`] where it sets parameters.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        let mut out = csv::Writer::from_writer(Output::create(path)?);
        let all_columns = format!("{TRAJECTORY_HEADER},{EVENT_COLUMNS},{BUDGET_COLUMNS},{PARAMETER_COLUMNS}");
        let columns = match (self.parameters.is_empty(), self.budgets.is_empty()) {
            (false, _) => VALUES + 1,
            (true, false) => PRICES + 1,
            (true, true) => BUDGET,
        };
        let opens = |event: &ToolEvent| matches!(event, ToolEvent::Pose(sample) if sample.opening > 0.0);
        let jaws = self.events.iter().any(|(.., event)| opens(event));
        let mut header: Vec<&str> = all_columns.split(',').take(columns).collect();
        if jaws {
            header.insert(OPENING, OPENING_COLUMN);
        }
        out.write_record(header)?;
        let none = |tick: &u64, event: &'static str| (*tick, None, event, Vec::new(), String::new());
        let mut rows: Vec<_> = self.resets.iter().map(|tick| none(tick, "reset")).collect();
        for (tick, Budget { limit, planned, frame, change }, prices) in &self.budgets {
            let prices = prices.map_or_else(String::new, |prices| prices.0.map(|price| price.to_string()).join(" "));
            let cells = vec![(BUDGET, format!("{limit} {planned} {frame} {change}")), (PRICES, prices)];
            rows.push((*tick, None, "budget", cells, String::new()));
        }
        for (tick, parameter) in &self.parameters {
            let values: Vec<_> = parameter.values().iter().map(Real::to_string).collect();
            let cells = vec![(PARAMETER, numbered_name(parameter)), (VALUES, values.join(" "))];
            rows.push((*tick, None, "set", cells, String::new()));
        }
        for (tick, tool, event) in &self.events {
            let opening = match event {
                ToolEvent::Pose(sample) => sample.opening.to_string(),
                ToolEvent::Attach { .. } | ToolEvent::Detach => String::new(),
            };
            let (event, cells) = match event {
                ToolEvent::Attach { period_ticks, coupling, .. } => {
                    let period = format!("{:.3}", Real::from(*period_ticks) * TICK);
                    let [linear, angular] = [coupling.compliance, coupling.angular_compliance].map(|c| c.to_string());
                    ("attach", vec![(PERIOD, period), (COUPLING, linear), (ANGULAR_COUPLING, angular)])
                }
                ToolEvent::Detach => ("detach", Vec::new()),
                ToolEvent::Pose(sample) => {
                    let Pose { position, orientation } = &sample.pose;
                    let numbers = position.iter().chain(orientation).map(Real::to_string);
                    ("pose", (POSITION..).zip(numbers.chain([sample.buttons.to_string()])).collect())
                }
            };
            rows.push((*tick, Some(*tool), event, cells, opening));
        }
        rows.sort_by_key(|row| (row.0, row.1));
        for (tick, tool, event, cells, opening) in rows {
            let mut fields = vec![String::new(); columns];
            fields[0] = format!("{:.3}", tick.saturating_sub(1) as Real * TICK);
            fields[1] = tool.map_or_else(String::new, |tool| tool.to_string());
            fields[EVENT] = event.to_owned();
            cells.into_iter().for_each(|(at, cell)| fields[at] = cell);
            if jaws {
                fields.insert(OPENING, opening);
            }
            out.write_record(fields)?;
        }
        out.into_inner().map_err(|e| e.into_error())?.finish()
    }
}

/// A header without the column of openings, and whether it had it.
fn without_opening(header: &csv::StringRecord) -> (csv::StringRecord, bool) {
    let jaws = header.get(OPENING) == Some(OPENING_COLUMN);
    let rest = header.iter().enumerate().filter(|(at, _)| !jaws || *at != OPENING).map(|(_, name)| name);
    (rest.collect(), jaws)
}

/// What a row says.
#[derive(Clone, Debug)]
enum Row {
    Pose(PoseSample),
    Attach { period_ticks: u32, coupling: Coupling },
    Detach,
    Reset,
    Budget(Budget, Option<Prices>),
    Set(Parameter),
}

impl Row {
    fn is_pose(&self) -> bool {
        matches!(self, Self::Pose(_))
    }
}

/// Of several poses of a tool in one tick the newest counts, as in a mailbox; rows of a tool and tick stand together.
fn keep_newest(rows: &mut Vec<(u64, Option<usize>, Row)>) {
    rows.reverse();
    rows.dedup_by(|a, b| a.1.is_some() && (a.0, a.1) == (b.0, b.1));
    rows.reverse();
}

/// The cells of one row.
struct Cells<'a> {
    fields: Vec<&'a str>,
    /// Beside them, where there is such a column.
    opening: Option<&'a str>,
    /// (fields) what their columns are called.
    names: &'a [&'a str],
}

impl Cells<'_> {
    /// Tick, tool and what happens; a reset has no tool.
    fn row(&self, tools: usize) -> Result<(u64, Option<usize>, Row), String> {
        let (found, expected) = (self.fields.len(), self.names.len());
        if found != expected {
            return Err(format!("{expected} columns are expected, found {found}"));
        }
        let time = self.within(0, 0.0..=1e6)?;
        let tick = (time / TICK + 1e-6).floor() as u64 + 1;
        let event = self.fields.get(EVENT).copied().unwrap_or("pose");
        let none = 0..0;
        let used = match event {
            "pose" => [1..EVENT, none],
            "attach" => [1..2, PERIOD..BUDGET],
            "detach" => [1..2, none],
            "reset" => [none.clone(), none],
            "budget" if expected > BUDGET => [BUDGET..PRICES + 1, none],
            "set" if expected > PARAMETER => [PARAMETER..VALUES + 1, none],
            _ => return Err(format!("event {event:?}: pose, attach, detach or reset is expected")),
        };
        let unused = |at: &usize| *at != EVENT && !used.iter().any(|range| range.contains(at));
        let filled = (1..found).find(|at| unused(at) && !self.fields[*at].is_empty()).map(|at| self.names[at]);
        let opened = self.opening.filter(|cell| event != "pose" && !cell.is_empty()).map(|_| OPENING_COLUMN);
        if let Some(name) = filled.or(opened) {
            return Err(format!("{name}: a row \"{event}\" has none: leave it empty"));
        }
        if event == "reset" {
            return Ok((tick, None, Row::Reset));
        }
        if event == "budget" {
            let [limit, planned, frame, change] = self.whole_numbers(BUDGET)?;
            let prices = if self.fields[PRICES].is_empty() { None } else { Some(Prices(self.whole_numbers(PRICES)?)) };
            return Ok((tick, None, Row::Budget(Budget { limit, planned, frame, change }, prices)));
        }
        if event == "set" {
            let values =
                self.fields[VALUES].split_whitespace().map(|value| value.parse().ok().filter(|v: &Real| v.is_finite()));
            let values: Option<Vec<Real>> = values.collect();
            let parameter = values.and_then(|values| numbered(self.fields[PARAMETER], &values));
            let parameter = parameter.ok_or_else(|| {
                format!(
                    "parameter {:?} with {:?}: gravity with three numbers, or damping, supports, stiffness.N, friction.N or resolution.split, merge or reach with one",
                    self.fields[PARAMETER], self.fields[VALUES]
                )
            })?;
            return Ok((tick, None, Row::Set(parameter)));
        }
        let tool = self.fields[1].parse::<usize>().ok().filter(|tool| *tool < tools);
        let tool = tool.ok_or_else(|| {
            format!("tool {:?}: the scene has the tools 0 to {}", self.fields[1], tools.saturating_sub(1))
        })?;
        let row = match event {
            "pose" => Row::Pose(self.pose(time)?),
            "attach" => {
                // None is the stiffest.
                let compliance =
                    |at: usize| if self.fields[at].is_empty() { Ok(0.0) } else { self.within(at, 0.0..=1e6) };
                Row::Attach {
                    period_ticks: (self.within(PERIOD, TICK..=LONGEST_PERIOD)? / TICK).round() as u32,
                    coupling: Coupling {
                        compliance: compliance(COUPLING)?,
                        angular_compliance: compliance(ANGULAR_COUPLING)?,
                    },
                }
            }
            _ => Row::Detach,
        };
        Ok((tick, Some(tool), row))
    }

    fn pose(&self, time: Real) -> Result<PoseSample, String> {
        let mut numbers = [0.0; BUTTONS - POSITION];
        for (at, number) in (POSITION..).zip(&mut numbers) {
            *number = self.number(at)?;
        }
        let [x, y, z, qx, qy, qz, qw] = numbers;
        let orientation = normalized_quaternion([qx, qy, qz, qw])
            .ok_or_else(|| "qx,qy,qz,qw must be a quaternion other than zero".to_owned())?;
        debug_assert_eq!(self.names[ORIENTATION], "qx");
        Ok(PoseSample {
            sequence: 0,
            time_ns: (time * 1e9) as u64,
            pose: Pose { position: Vec3::new(x, y, z), orientation },
            buttons: self.within(BUTTONS, 0.0..=Real::from(u32::MAX))? as u32,
            opening: self.opening()?,
        })
    }

    fn opening(&self) -> Result<Real, String> {
        let Some(cell) = self.opening.filter(|cell| !cell.is_empty()) else { return Ok(0.0) };
        let opening = cell.parse::<Real>().ok().filter(|opening| (0.0..=1.0).contains(opening));
        opening.ok_or_else(|| format!("{OPENING_COLUMN}: {cell:?} is not a number within 0 to 1"))
    }

    /// So many whole numbers, separated by spaces.
    fn whole_numbers<const N: usize>(&self, at: usize) -> Result<[u32; N], String> {
        let numbers: Option<Vec<u32>> = self.fields[at].split_whitespace().map(|number| number.parse().ok()).collect();
        let numbers = numbers.and_then(|numbers| <[u32; N]>::try_from(numbers).ok());
        numbers.ok_or_else(|| format!("{}: {N} whole numbers are expected, with a space between", self.names[at]))
    }

    fn number(&self, at: usize) -> Result<Real, String> {
        let number = self.fields[at].parse::<Real>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| format!("{}: {:?} is not a finite number", self.names[at], self.fields[at]))
    }

    fn within(&self, at: usize, range: std::ops::RangeInclusive<Real>) -> Result<Real, String> {
        let number = self.number(at)?;
        let (low, high) = (range.start(), range.end());
        let fault = || format!("{}: {number} is not within {low} to {high}", self.names[at]);
        range.contains(&number).then_some(number).ok_or_else(fault)
    }
}

#[cfg(test)]
mod tests;
