use covista_world::{
    Action, ActionVerdict, BarrierKind, ControlInput, FilterOutcome, LaneIndex, STEP_S,
};

use crate::barriers::Row;
use crate::barriers::affine::{AffineBarrier, AffineRow, Dynamics};
use crate::barriers::bounds::Bounds;
use crate::execution::Execution;
use crate::filter::{Filtered, filter};
use crate::manoeuvre::Course;
use crate::memory::{Excused, Memory};
use crate::qp::Qp;
use crate::reference::reference;
use crate::rows::{Rows, shortfall};
use crate::validator::{backup, is_valid};
use crate::verdict::Judge;
use crate::{
    ControlSettings, Formulation, Manoeuvre, Mode, SafetySettings, SettingsError, Situation, paper,
};

/// The control input of one step and how it came about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlOutput {
    /// The safe input to apply.
    pub u: ControlInput,
    /// The reference U a.
    pub u_nominal: ControlInput,
    /// What became of the reference.
    pub outcome: FilterOutcome,
    /// Whether it is an emergency stop (Alg. 1): hardest braking within the lane, for which the
    /// planner's reward has a penalty.
    pub emergency: bool,
    /// Smallest h of the front and sight rows, towards the worst member of each estimate.
    pub h_m: f64,
    /// Smallest h_0 of the front rows; infinite with nobody ahead.
    pub h0_m: f64,
    /// Smaller of h_y,max and h_y,min.
    pub h_lateral_m: f64,
    /// The row that moved the input away from the reference.
    pub binding: Option<BarrierKind>,
    /// zeta: by how much the hard rows are missed, in units of h.
    pub slack: f64,
    /// zeta / eta, by which Theorem 2 enlarges the safe set that stays invariant.
    pub enlargement: f64,
    /// Acceleration that the rows towards followers ask for beyond what is applied.
    pub rear_slack_mps2: f64,
}

/// The controller of one CAV.
#[derive(Debug, Clone)]
pub struct Controller {
    settings: ControlSettings,
    execution: Execution,
    last: ControlInput,
    memory: Memory,
    barriers: Vec<AffineBarrier>,
    qp: Qp,
    // Storage of one step, used again in the next.
    rows: Rows,
    judged: Rows,
    affine: Vec<AffineRow>,
}

impl Controller {
    /// A controller of a vehicle that keeps `lane`.
    ///
    /// # Errors
    /// When a setting is out of its range.
    pub fn new(settings: ControlSettings, lane: LaneIndex) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            settings: settings.effective(),
            execution: Execution::new(lane),
            last: ControlInput::default(),
            memory: Memory::default(),
            barriers: Vec::new(),
            qp: Qp::default(),
            rows: Rows::default(),
            judged: Rows::default(),
            affine: Vec::new(),
        })
    }

    /// Adds a barrier of one's own: h = p'x + q in road coordinates x = [s, d, psi, v]. Its row is
    /// p'g(x) u, with which steering and acceleration are coupled, so that Clarabel solves the QP,
    /// whatever solver the settings name. The row is tightened by the bounds of the process noise.
    /// Only [`Mode::Safe`] has it.
    ///
    /// A position p_s, p_d needs a part in speed or heading to be kept, say p = [-1, 0, 0, -2] to
    /// stop before some s: g(x) has no row for positions, so without it u is not in the constraint.
    ///
    /// # Errors
    /// When a number is not finite, or p_psi = p_v = 0.
    pub fn add_barrier(&mut self, barrier: AffineBarrier) -> Result<(), SettingsError> {
        if !barrier.is_finite() {
            return Err(SettingsError::Barrier);
        }
        if barrier.p[2] == 0.0 && barrier.p[3] == 0.0 {
            return Err(SettingsError::BarrierWithoutInput);
        }
        self.barriers.push(barrier);
        Ok(())
    }

    /// What the vehicle is about; `manoeuvre().action()` is what it should tell others.
    pub fn manoeuvre(&self) -> Manoeuvre {
        self.execution.manoeuvre()
    }

    /// The settings; without noise where the formulation has none.
    pub fn settings(&self) -> &ControlSettings {
        &self.settings
    }

    /// The neighbours towards which h < 0 in the last step, and why.
    pub fn excused(&self) -> &[Excused] {
        self.memory.excused()
    }

    /// Whether `action` is safe now (Alg. 1, line 2), and if not, which row says so.
    ///
    /// While a lane change runs, its own action stands for going on and keeping lane for going back.
    pub fn verdict(&self, situation: &Situation<'_>, action: Action) -> ActionVerdict {
        if !is_usable(situation) && action != Action::EmergencyStop {
            return ActionVerdict::Unsafe(BarrierKind::Manoeuvre);
        }
        let (manoeuvre, mut rows) = (self.manoeuvre(), Rows::default());
        let mut judge = self.judge(situation, &mut rows);
        match self.settings.mode {
            Mode::Safe => judge.verdict(&manoeuvre, action),
            Mode::Off => judge.possible(&manoeuvre, action),
            // Its QP has a solution whatever the action, but for the one without slack.
            Mode::Paper => match judge.possible(&manoeuvre, action) {
                ActionVerdict::Safe if self.settings.qp.formulation == Formulation::NoiseFree => {
                    self.paper_verdict(situation, action)
                }
                possible => possible,
            },
        }
    }

    /// What [`Mode::Safe`] would say of `action` now, whatever the mode is: who drives without the
    /// promise is measured by it.
    pub fn safe_verdict(&self, situation: &Situation<'_>, action: Action) -> ActionVerdict {
        if !is_usable(situation) && action != Action::EmergencyStop {
            return ActionVerdict::Unsafe(BarrierKind::Manoeuvre);
        }
        self.judge(situation, &mut Rows::default())
            .verdict(&self.manoeuvre(), action)
    }

    /// Takes the behaviour of the coming behaviour step. A lane change is announced first and
    /// starts when its verdict is still safe then; keeping lane while it runs gives it up, if the
    /// way back is safe.
    pub fn set_action(&mut self, action: Action, time_s: f64) {
        self.execution.set_action(action, time_s);
    }

    /// One step at 100 Hz: moves the manoeuvre on and gives the input to apply.
    pub fn control(&mut self, situation: &Situation<'_>) -> ControlOutput {
        if !is_usable(situation) {
            return self.blind_backup(situation);
        }
        let situation = &settled(situation);
        self.advance(situation);
        let course = self.execution.course(situation, &self.settings.safety);
        let path = self.execution.path(situation);
        let last_mps2 = self.last.accel_mps2;
        let u_nominal = reference(situation, &course, &path, last_mps2, &self.settings);
        self.filtered(situation, &course, u_nominal)
    }

    /// As [`Controller::control`], for any nominal input instead of the reference.
    pub fn filter(&mut self, situation: &Situation<'_>, u_nominal: ControlInput) -> ControlOutput {
        let is_finite = u_nominal.tan_delta.is_finite() && u_nominal.accel_mps2.is_finite();
        if !is_finite || !is_usable(situation) {
            return self.blind_backup(situation);
        }
        let situation = &settled(situation);
        self.advance(situation);
        let course = self.execution.course(situation, &self.settings.safety);
        self.filtered(situation, &course, u_nominal)
    }

    fn judge<'a>(&'a self, situation: &'a Situation<'a>, rows: &'a mut Rows) -> Judge<'a> {
        Judge {
            situation,
            memory: &self.memory,
            safety: &self.settings.safety,
            rows,
        }
    }

    fn advance(&mut self, situation: &Situation<'_>) {
        let mut judge = Judge {
            situation,
            memory: &self.memory,
            safety: &self.settings.safety,
            rows: &mut self.judged,
        };
        self.execution
            .advance(&mut judge, &self.rows, &self.settings);
    }

    fn filtered(
        &mut self,
        situation: &Situation<'_>,
        course: &Course,
        u_nominal: ControlInput,
    ) -> ControlOutput {
        let settings = self.settings;
        let safety = &settings.safety;
        let ego = &situation.ego;
        let (v, wheelbase_m) = (ego.state.speed_mps, ego.dimensions.wheelbase_m);
        self.rows.collect(situation, course, &self.memory, safety);
        let emergency = self.execution.action() == Action::EmergencyStop;
        let u_nominal = ControlInput {
            accel_mps2: if emergency {
                self.rows.bounds.accel_min_mps2
            } else {
                u_nominal.accel_mps2
            },
            ..u_nominal
        };
        let rear_needs_mps2 = (self.rows.rear.iter())
            .map(|row| row.lower.min(self.rows.bounds.accel_max_mps2))
            .fold(f64::NEG_INFINITY, f64::max);
        self.yield_to_front(emergency);
        let mut filtered = self.answer(situation, course, u_nominal);
        let mut slack = 0.0;
        if filtered.outcome == FilterOutcome::Relaxed && settings.mode == Mode::Safe {
            slack = shortfall(situation, course, &self.memory, safety, filtered.u);
            slack =
                (self.affine.iter()).fold(slack, |most, row| most.max(row.shortfall(filtered.u)));
            let allowed = settings.qp.formulation != Formulation::NoiseFree;
            if !allowed || slack > settings.qp.slack_max {
                filtered.outcome = FilterOutcome::Backup;
                filtered.u.accel_mps2 = self.rows.bounds.accel_min_mps2;
            }
        }
        if !is_valid(filtered.u, v, wheelbase_m, safety) {
            filtered.outcome = FilterOutcome::Backup;
            filtered.u = backup(v, wheelbase_m, self.last.tan_delta, safety);
        }
        self.last = filtered.u;
        self.memory.update(situation.neighbours, &self.rows.hard);
        ControlOutput {
            u: filtered.u,
            u_nominal,
            outcome: filtered.outcome,
            emergency,
            h_m: smallest(&self.rows, |row| row.h),
            h0_m: smallest(&self.rows, |row| row.h0_m),
            h_lateral_m: self.rows.h_lateral_m,
            binding: filtered.binding,
            slack,
            enlargement: slack / safety.eta,
            rear_slack_mps2: (rear_needs_mps2 - filtered.u.accel_mps2).max(0.0),
        }
    }

    /// What the mode makes of the nominal input.
    fn answer(
        &mut self,
        situation: &Situation<'_>,
        course: &Course,
        u_nominal: ControlInput,
    ) -> Filtered {
        let settings = self.settings;
        self.affine.clear();
        match settings.mode {
            Mode::Off => {
                return Filtered {
                    u: self.rows.bounds.clamp(u_nominal),
                    outcome: FilterOutcome::Nominal,
                    binding: None,
                };
            }
            Mode::Paper => {
                let rows = paper::rows(situation, course, &settings.safety, &settings.qp);
                self.affine.extend(rows);
                let u_nominal = self.rows.bounds.clamp(u_nominal);
                return paper::answer(
                    u_nominal,
                    &self.affine,
                    self.rows.bounds,
                    &mut self.qp,
                    &settings.qp,
                );
            }
            Mode::Safe => {
                let rows = own_rows(&self.barriers, situation, &settings.safety);
                self.affine.extend(rows);
            }
        }
        filter(
            u_nominal,
            &self.rows,
            &self.affine,
            &mut self.qp,
            settings.solver,
            &settings.qp,
        )
    }

    /// A lane change that has begun does not brake for comfort before a follower, but speeds up
    /// for none, and an emergency stop heeds none.
    fn yield_to_front(&mut self, emergency: bool) {
        if emergency {
            self.rows.rear.clear();
        }
        for row in &mut self.rows.rear {
            row.lower = row.lower.min(0.0);
        }
    }

    /// Whether the paper's QP without slack has a solution.
    fn paper_verdict(&self, situation: &Situation<'_>, action: Action) -> ActionVerdict {
        let course = (self.execution).course_of(situation, action, &self.settings.safety);
        let ego = &situation.ego;
        let safety = &self.settings.safety;
        let bounds = Bounds::new(ego.state.speed_mps, ego.dimensions.wheelbase_m, safety);
        let rows: Vec<_> = paper::rows(situation, &course, safety, &self.settings.qp).collect();
        let u = bounds.clamp(ControlInput::default());
        let answer = paper::answer(u, &rows, bounds, &mut Qp::default(), &self.settings.qp);
        match (answer.outcome, answer.binding) {
            (FilterOutcome::Backup, Some(kind)) => ActionVerdict::Unsafe(kind),
            _ => ActionVerdict::Safe,
        }
    }

    /// The answer to an input that is no number: brake, and hold the steering.
    fn blind_backup(&mut self, situation: &Situation<'_>) -> ControlOutput {
        let ego = &situation.ego;
        let u = backup(
            ego.state.speed_mps,
            ego.dimensions.wheelbase_m,
            self.last.tan_delta,
            &self.settings.safety,
        );
        self.last = u;
        ControlOutput {
            u,
            u_nominal: u,
            outcome: FilterOutcome::Backup,
            emergency: false,
            h_m: f64::NEG_INFINITY,
            h0_m: f64::NEG_INFINITY,
            h_lateral_m: f64::NEG_INFINITY,
            binding: None,
            slack: 0.0,
            enlargement: 0.0,
            rear_slack_mps2: 0.0,
        }
    }
}

/// The rows of the user's barriers, with the noise term -|p|_1 W of each component.
fn own_rows<'a>(
    barriers: &'a [AffineBarrier],
    situation: &Situation<'_>,
    safety: &SafetySettings,
) -> impl Iterator<Item = AffineRow> + use<'a> {
    let ego = &situation.ego;
    let (v, wheelbase_m) = (ego.state.speed_mps, ego.dimensions.wheelbase_m);
    let dynamics = Dynamics::new(&ego.frenet, v, wheelbase_m);
    let moving = if v > 0.0 { 1.0 } else { 0.0 };
    let step_m = v * STEP_S;
    let noise = [
        moving * safety.noise_position_m * situation.profile.longest_metre(),
        step_m * safety.noise_slip_rad + moving * safety.noise_position_m,
        step_m * safety.noise_curvature_per_m,
        safety.noise_speed_mps,
    ];
    let eta = safety.eta;
    (0_u16..).zip(barriers).map(move |(i, barrier)| {
        let worst: f64 = barrier.p.iter().zip(noise).map(|(p, w)| p.abs() * w).sum();
        barrier.row(BarrierKind::Affine(i), &dynamics, eta, worst)
    })
}

fn is_usable(situation: &Situation<'_>) -> bool {
    let size = &situation.ego.dimensions;
    situation.ego.is_finite()
        && situation.ego.state.speed_mps >= 0.0
        && size.length_m.min(size.width_m).min(size.wheelbase_m) > 0.0
        && size.rear_overhang_m >= 0.0
        && situation.time_s.is_finite()
        && situation.desired_speed_mps.is_finite()
        && situation.sight.is_usable()
        && situation.neighbours.iter().all(crate::Neighbour::is_finite)
}

/// A vehicle that stands but for rounding stands.
fn settled<'a>(situation: &Situation<'a>) -> Situation<'a> {
    let mut situation = *situation;
    if situation.ego.state.speed_mps < STANDING_MPS {
        situation.ego.state.speed_mps = 0.0;
    }
    situation
}

const STANDING_MPS: f64 = 1e-9;

fn smallest(rows: &Rows, level: impl Fn(&Row) -> f64) -> f64 {
    rows.hard
        .iter()
        .filter(|row| {
            matches!(
                row.kind,
                BarrierKind::FrontCurrent | BarrierKind::FrontTarget | BarrierKind::Sight
            )
        })
        .map(level)
        .fold(f64::INFINITY, f64::min)
}
