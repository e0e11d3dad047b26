//! The closed loop on the three-lane ring: where policies learn and are compared. Sensors and
//! networks run on request only.

mod cav;
mod knowledge;
mod motion;
mod perceived;
mod perception;
mod settings;
mod sights;
mod tally;
mod timing;
mod view;
mod watch;

use std::sync::Arc;

use covista_control::{Manoeuvre, RoadProfile};
use covista_planner::{
    self as planner, Observation, OwnMotion,
    learning::{
        Environment, EnvironmentError, FeatureEncoder, InputShares, Outcome, Shape, Situations,
    },
};
use covista_sensors::ErrorModel;
use covista_traffic::Ring;
use covista_world::{Action, ControlInput, Road, StationId};

use cav::{RingCav, nearest_lane};
use knowledge::Exact;
use motion::Motion;
pub use motion::RingMotion;
use perceived::{Drawn, Eyes, Perceived, Rendered};
pub use perception::RingPerception;
use perception::{Frame, Knowledge};
pub use settings::{RingEnvironmentError, RingEnvironmentSettings};
use sights::Sights;
pub use tally::RingTally;
pub use timing::time_closed_loop;
pub use watch::RingSafety;
use watch::Watch;

use crate::Networks;

/// Steps of 0.01 s between two frames of perception and messages, and between two decisions.
const FRAME_STEPS: u64 = 10;
pub(crate) const BEHAVIOUR_STEPS: u64 = 50;
pub(crate) const BEHAVIOUR_S: f64 = 0.5;
/// The same of who steers: no control input is good for 0.5 s.
pub(crate) const STEERING_STEPS: u64 = 10;
const STEERING_S: f64 = 0.1;

/// CAVs and human drivers on the three-lane ring, in closed loop: what each CAV sees and is told,
/// its controller at 100 Hz, a decision every 0.5 s; who steers, through the same filter, decides
/// every 0.1 s.
///
/// A CAV knows a vehicle when it has line of sight to it, or, with sharing, when it hears it or a
/// CAV that has: exactly, as of the newest frame (10 Hz), or by a tracker of its own
/// ([`RingPerception`]).
pub struct RingEnvironment {
    settings: RingEnvironmentSettings,
    ring: Ring,
    profile: RoadProfile,
    cavs: Vec<RingCav>,
    sights: Sights,
    /// For perception with errors.
    eyes: Option<Eyes>,
    knowledge: Box<dyn Knowledge>,
    watch: Option<Watch>,
    motion: Option<Motion>,
    encoder: FeatureEncoder,
    step: u64,
    tally: RingTally,
    /// Whether the CAVs steer instead of choosing behaviours, in this episode.
    is_steered: bool,
    // Storage of one step, used again in the next.
    inputs: Vec<ControlInput>,
    /// Speeds at the last decision, and at the beginning of the behaviour step.
    speeds_mps: Vec<f64>,
    behaviour_mps: Vec<f64>,
    driven: Vec<Action>,
}

impl RingEnvironment {
    /// Sets the first episode up, with the seed of the ring's settings. The road is unrolled for
    /// episodes of `settings.steps`.
    ///
    /// # Errors
    /// When a setting makes no sense or asks for networks.
    pub fn new(settings: RingEnvironmentSettings) -> Result<Self, RingEnvironmentError> {
        Self::with_networks(settings, None)
    }

    /// As [`RingEnvironment::new`], with the networks of [`RingPerception::Network`].
    ///
    /// # Errors
    /// When a setting makes no sense, asks for networks that are not given, or one fails.
    pub fn with_networks(
        mut settings: RingEnvironmentSettings,
        networks: Option<&Networks>,
    ) -> Result<Self, RingEnvironmentError> {
        if settings.ring.cavs == 0 {
            return Err(RingEnvironmentError::NoCavs);
        }
        if settings.steps == 0 {
            return Err(RingEnvironmentError::NoSteps);
        }
        if settings.communication_m.is_nan() || settings.communication_m < 0.0 {
            return Err(RingEnvironmentError::Communication(
                settings.communication_m,
            ));
        }
        settings.ring.duration_s = settings.steps as f64 * BEHAVIOUR_S;
        settings.control.validate()?;
        let ring = Ring::new(settings.ring)?;
        let profile = RoadProfile::new(Arc::clone(ring.road().road()), &settings.control);
        let mut environment = Self {
            encoder: FeatureEncoder::new(Some(ring.road().period_m())),
            cavs: Vec::new(),
            sights: Sights::default(),
            eyes: eyes(settings.perception, networks)?,
            knowledge: Box::new(Exact::default()),
            watch: None,
            motion: None,
            is_steered: false,
            step: 0,
            tally: RingTally::default(),
            inputs: Vec::new(),
            speeds_mps: Vec::new(),
            behaviour_mps: Vec::new(),
            driven: Vec::new(),
            settings,
            ring,
            profile,
        };
        environment.start(settings.ring.seed)?;
        Ok(environment)
    }

    /// What it was set up with.
    pub fn settings(&self) -> &RingEnvironmentSettings {
        &self.settings
    }

    /// The traffic, with its own figures.
    pub fn ring(&self) -> &Ring {
        &self.ring
    }

    /// What happened in this episode.
    pub fn tally(&self) -> RingTally {
        self.tally
    }

    /// What the monitor found in this episode, where it looks on.
    pub fn safety(&self) -> Option<RingSafety> {
        self.watch.as_ref().map(Watch::safety)
    }

    /// Keeps from now on how smoothly the CAVs drive in this episode.
    pub fn record_motion(&mut self) {
        self.motion = Some(Motion::default());
    }

    /// How smoothly they drove since [`RingEnvironment::record_motion`].
    pub fn motion(&self) -> Option<RingMotion> {
        let road = self.ring.road().road();
        self.motion.as_ref().map(|motion| motion.figures(road))
    }

    /// The encoder, which counts how often K neighbours were too few.
    pub fn encoder(&self) -> &FeatureEncoder {
        &self.encoder
    }

    fn start(&mut self, seed: u64) -> Result<(), RingEnvironmentError> {
        self.ring.reset(seed)?;
        (self.step, self.tally) = (0, RingTally::default());
        (self.motion, self.is_steered) = (None, false);
        let settings = &self.settings;
        self.watch = (settings.watched).then(|| Watch::new(settings.control.safety));
        let road = self.ring.road().road();
        self.cavs.clear();
        for vehicle in &self.ring.vehicles()[..settings.ring.cavs] {
            self.cavs
                .push(RingCav::new(vehicle, road, settings.control)?);
        }
        self.knowledge = match &self.eyes {
            None => Box::new(Exact::default()),
            Some(eyes) => Box::new(Perceived::new(eyes.clone(), &self.cavs)),
        };
        self.frame()?;
        self.carry_on();
        Ok(())
    }

    /// One behaviour step: everybody's actions, then 0.5 s of the closed loop.
    fn drive(
        &mut self,
        actions: &[Action],
        outcome: &mut Outcome,
    ) -> Result<(), RingEnvironmentError> {
        let time_s = self.ring.time_s();
        self.note_speeds();
        for (cav, &action) in self.cavs.iter_mut().zip(actions) {
            self.tally.decides(cav, action);
            cav.set_action(action, time_s);
        }
        let driven = self.go_on(BEHAVIOUR_STEPS, outcome)?;
        self.driven.clear();
        let about = self.cavs.iter().zip(actions);
        self.driven
            .extend(about.map(|(cav, &action)| cav.driven(action)));
        self.reward(driven, outcome);
        self.tally.ends(&self.ring, &self.driven, &self.speeds_mps);
        Ok(())
    }

    /// 0.1 s of the closed loop with control inputs of the CAVs' own choice. Who stands on the line
    /// of a lane is about to change lanes.
    fn drive_by(
        &mut self,
        inputs: &[InputShares],
        outcome: &mut Outcome,
    ) -> Result<(), RingEnvironmentError> {
        self.is_steered = true;
        self.note_speeds();
        if self.step.is_multiple_of(BEHAVIOUR_STEPS) {
            self.behaviour_mps.clone_from(&self.speeds_mps);
            let actions = self.cavs.len() as u64;
            self.tally.decisions += actions;
        }
        for (cav, &input) in self.cavs.iter_mut().zip(inputs) {
            cav.steer(input, self.ring.road().road())?;
        }
        let driven = self.go_on(STEERING_STEPS, outcome)?;
        let road = self.ring.road().road();
        self.driven.clear();
        self.driven
            .extend(self.cavs.iter().map(|cav| cav.steered(road)));
        self.reward(driven, outcome);
        if self.step.is_multiple_of(BEHAVIOUR_STEPS) || outcome.is_over {
            self.tally
                .ends(&self.ring, &self.driven, &self.behaviour_mps);
        }
        Ok(())
    }

    fn note_speeds(&mut self) {
        self.speeds_mps.clear();
        self.speeds_mps
            .extend(self.ring.vehicles().iter().map(|vehicle| vehicle.speed_mps));
    }

    /// `steps` of the closed loop, or those up to the episode's end; tells what share of a behaviour
    /// step that is. A collision cuts the step short, and its reward.
    fn go_on(&mut self, steps: u64, outcome: &mut Outcome) -> Result<f64, RingEnvironmentError> {
        let first = self.step;
        while self.step < first + steps && !outcome.is_over {
            self.control_step()?;
            self.note_collisions(outcome);
        }
        outcome.is_over |= self.step >= self.settings.steps * BEHAVIOUR_STEPS;
        Ok((self.step - first) as f64 / BEHAVIOUR_STEPS as f64)
    }

    /// Rewards what everybody was about over this share of a behaviour step.
    fn reward(&mut self, driven: f64, outcome: &mut Outcome) {
        for (index, (cav, &action)) in self.cavs.iter().zip(&self.driven).enumerate() {
            let gained_mps = cav.state.speed_mps - self.speeds_mps[index];
            let accel_mps2 = gained_mps / (driven * BEHAVIOUR_S);
            let reward = &self.settings.reward;
            let mut r = driven * reward.of(cav.state.speed_mps, accel_mps2, action);
            if outcome.terminated[index] {
                r -= reward.collision_penalty;
            }
            outcome.rewards[index] = r as f32;
            self.tally.reward += r;
        }
    }

    fn control_step(&mut self) -> Result<(), RingEnvironmentError> {
        let time_s = self.ring.time_s();
        self.inputs.clear();
        for cav in &mut self.cavs {
            self.inputs.push(cav.control(time_s, &self.profile));
            self.tally.controls(cav);
        }
        if let Some(watch) = &mut self.watch {
            watch.step(&self.ring, &self.cavs, &self.profile);
        }
        self.ring.step(&self.inputs)?;
        self.step += 1;
        let road = self.ring.road().road();
        for (cav, vehicle) in self.cavs.iter_mut().zip(self.ring.vehicles()) {
            cav.moves(vehicle, road);
        }
        if let Some(motion) = &mut self.motion {
            motion.step(&self.cavs, road);
        }
        if self.step.is_multiple_of(FRAME_STEPS) {
            self.frame()?;
        }
        self.carry_on();
        Ok(())
    }

    /// A frame: everybody looks, and tells what they see and do.
    fn frame(&mut self) -> Result<(), RingEnvironmentError> {
        let (ring, safety) = (&self.ring, &self.settings.control.safety);
        let (road, time_s) = (self.profile.road(), ring.time_s());
        self.sights.frame(ring, self.cavs.len(), safety);
        self.knowledge.frame(&Frame {
            ring,
            cavs: &self.cavs,
            sights: &self.sights,
            profile: &self.profile,
            safety,
            sharing: self.settings.sharing,
            communication_m: self.settings.communication_m,
        })?;
        for (index, cav) in self.cavs.iter_mut().enumerate() {
            let knows = |lane, body: &_| self.knowledge.knows(index, lane, body);
            let pose = cav.state.pose;
            let seen = (self.knowledge)
                .sight(index, pose, road, time_s, safety)
                .unwrap_or_else(|| self.sights.free(index, time_s, road, safety, knows));
            cav.sight.update(&seen, time_s, safety);
        }
        if let Some(watch) = &mut self.watch {
            watch.frame(ring, self.cavs.len(), &self.sights, &*self.knowledge);
        }
        Ok(())
    }

    /// Brings what everybody knows to the present.
    fn carry_on(&mut self) {
        let safety = &self.settings.control.safety;
        self.knowledge
            .carry_on(&self.profile, self.ring.time_s(), safety);
        for (index, cav) in self.cavs.iter_mut().enumerate() {
            self.knowledge.neighbours(index, &mut cav.neighbours);
        }
    }

    fn note_collisions(&self, outcome: &mut Outcome) {
        if !self.settings.ends_at_collision {
            return;
        }
        for &(one, other) in self.ring.contacts() {
            for index in [one as usize, other as usize] {
                if let Some(terminated) = outcome.terminated.get_mut(index) {
                    *terminated = true;
                    outcome.is_over = true;
                }
            }
        }
        let road = self.ring.road().road();
        for (cav, terminated) in self.cavs.iter().zip(&mut outcome.terminated) {
            if self.is_steered && cav.is_beside_the_road(road) {
                *terminated = true;
                outcome.is_over = true;
            }
        }
    }

    fn observe(&mut self, situations: &mut Situations) -> Result<(), RingEnvironmentError> {
        let (road, time_s) = (self.ring.road().road(), self.ring.time_s());
        let count = self.cavs.len() as u32;
        self.knowledge.observe(&self.ring)?;
        for (index, cav) in self.cavs.iter_mut().enumerate() {
            if !self.is_steered {
                cav.consider(time_s, &self.profile);
            }
            let own = OwnMotion {
                state: cav.state,
                dimensions: cav.dimensions,
                lane: nearest_lane(road, cav.frenet.d_m),
                desired_speed_mps: cav.desired_speed_mps,
                manoeuvre: phase(cav.manoeuvre(), road, cav.frenet.d_m),
            };
            let observation = Observation {
                neighbours: self.knowledge.observed(index),
                ..Observation::new(road, &own, &[])?
            };
            let mut row = situations.get_mut(index);
            let agent_of = |station: StationId| Some(station.0 - 1).filter(|agent| *agent < count);
            self.encoder.encode(&observation, agent_of, &mut row)?;
            (*row.legal, *row.safe) = (cav.options.legal, cav.options.safe);
        }
        Ok(())
    }
}

impl Environment for RingEnvironment {
    fn shape(&self) -> Shape {
        self.settings.shape()
    }

    fn settings(&self) -> serde_json::Value {
        serde_json::to_value(self.settings).unwrap_or_default()
    }

    fn reset(&mut self, seed: u64, situations: &mut Situations) -> Result<(), EnvironmentError> {
        self.start(seed)
            .and_then(|()| self.observe(situations))
            .map_err(|source| failed(format!("to start episode {seed}"), source))
    }

    fn step(
        &mut self,
        actions: &[Action],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        let time_s = self.ring.time_s();
        self.drive(actions, outcome)
            .and_then(|()| self.observe(situations))
            .map_err(|source| failed(format!("at {time_s:.1} s"), source))
    }

    fn steer(
        &mut self,
        inputs: &[InputShares],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        let time_s = self.ring.time_s();
        self.drive_by(inputs, outcome)
            .and_then(|()| self.observe(situations))
            .map_err(|source| failed(format!("at {time_s:.1} s"), source))
    }
}

/// What CAVs see with, where they don't know exactly.
fn eyes(
    perception: RingPerception,
    networks: Option<&Networks>,
) -> Result<Option<Eyes>, RingEnvironmentError> {
    Ok(match perception {
        RingPerception::Exact => None,
        RingPerception::Statistical => Some(Eyes::Statistical(Drawn::new(ErrorModel::builtin()?))),
        RingPerception::Network => {
            let networks = networks.ok_or(RingEnvironmentError::NoNetworks)?;
            Some(Eyes::Network(Rendered::new(networks.clone())))
        }
    })
}

fn failed(when: String, source: RingEnvironmentError) -> EnvironmentError {
    EnvironmentError {
        when,
        source: Box::new(source),
    }
}

/// The running manoeuvre in the planner's words.
fn phase(manoeuvre: Manoeuvre, road: &Road, d_m: f64) -> planner::Manoeuvre {
    let (from, to) = match manoeuvre {
        Manoeuvre::ChangeLane { from, to, .. } => (from, to),
        Manoeuvre::Abort { from, back } => (from, back),
        Manoeuvre::KeepLane { .. } | Manoeuvre::Announced { .. } => {
            return planner::Manoeuvre::KeepingLane;
        }
    };
    let (start, end) = (road.lane_center_m(from), road.lane_center_m(to));
    planner::Manoeuvre::ChangingLane {
        from,
        to,
        progress: ((d_m - start) / (end - start)).clamp(0.0, 1.0),
    }
}

#[cfg(test)]
mod tests;
