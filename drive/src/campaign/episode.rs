use covista_control::{
    ControlOutput, ControlSettings, Controller, EgoState, Manoeuvre, Neighbour, SafetySettings,
    SightLine, Situation,
};
use covista_traffic::{VehicleId, VehicleKind};
use covista_world::{Action, ActionVerdict, LANE_COUNT, LaneIndex, Road, STEP_S, StationId};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::{
    CampaignError,
    broken::Broken,
    exact::SafeSet,
    nominal::{NominalPolicy, Nominals},
    other::{Merging, Script, TOP_MPS},
    pair::Seen,
    plant::{Plant, PlantModel},
    scenario::{Cast, EGO, EGO_ID, Scenario},
    tally::Tally,
    watch::{Judged, Watch},
};
use crate::{CavView, Monitor, PlacedTrack, TrueVehicle};

const STATION: StationId = StationId(1);
/// Steps between two behaviour decisions.
const DECISION_STEPS: usize = 50;
/// Steps for which a wish for a lane change lasts.
const WISH_STEPS: usize = 200;

/// What an episode is run under, besides what is drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct Conditions {
    pub control: ControlSettings,
    pub plant: PlantModel,
    pub broken: Option<Broken>,
    pub nominal: Nominals,
    /// Bounds of the noise that the plant really has.
    pub noise: SafetySettings,
    /// Whether the monitor runs along.
    pub is_monitored: bool,
}

/// One vehicle in closed loop with its controller among others.
pub(super) struct Episode<'a> {
    scenario: Scenario,
    conditions: &'a Conditions,
    controller: Controller,
    plant: Plant,
    dice: ChaCha8Rng,
    /// For each other vehicle since when it has been in sight.
    in_sight_since: Vec<Option<usize>>,
    is_known: Vec<bool>,
    /// For each other vehicle since when the ego vehicle has been coming into its lane before it.
    merging_since: Vec<Option<usize>>,
    wish: Action,
    tracks: Vec<PlacedTrack>,
    neighbours: Vec<Neighbour>,
}

impl<'a> Episode<'a> {
    pub fn new(
        mut scenario: Scenario,
        conditions: &'a Conditions,
        dice: ChaCha8Rng,
    ) -> Result<Self, CampaignError> {
        let others = scenario.cast.len();
        if conditions.nominal == Nominals::Own {
            scenario.nominal.policy = NominalPolicy::Reference;
        }
        if conditions.plant != PlantModel::Kinematic {
            scenario.wishes.clear();
        }
        Ok(Self {
            controller: Controller::new(conditions.control, scenario.lane)?,
            plant: Plant::new(conditions.plant, scenario.state, EGO, &scenario.road),
            conditions,
            dice,
            in_sight_since: vec![None; others],
            is_known: vec![false; others],
            merging_since: vec![None; others],
            wish: Action::KeepLane,
            tracks: Vec::new(),
            neighbours: Vec::new(),
            scenario,
        })
    }

    /// What was drawn, in words.
    pub fn described(&self) -> Vec<String> {
        let scenario = &self.scenario;
        let sharpest = scenario.road.sharpest_per_m();
        let mut lines = vec![
            format!(
                "lane {:?}, ego {:?}, sharpest curvature {sharpest:.5}, lane width {:.2} m",
                scenario.lane,
                scenario.state,
                scenario.road.lane_width_m()
            ),
            format!("{:?}, noise {:?}", scenario.nominal, scenario.noise),
            format!("{:?}", scenario.estimate),
            format!(
                "sight {:.1} m, said {:.1} m farther, tracks after {} steps",
                scenario.sight_range_m, scenario.sight_error_m, scenario.delay_steps
            ),
        ];
        lines.extend(scenario.cast.iter().map(|cast| format!("{cast:?}")));
        lines
    }

    /// Drives `steps` steps and tells what was found. `look` sees every situation and the
    /// controller before it acts.
    pub fn run(self, steps: usize, look: impl FnMut(&Situation<'_>, &Controller)) -> Tally {
        self.run_into(Tally::default(), steps, look)
    }

    /// The same, found into `tally`.
    pub fn run_into(
        mut self,
        tally: Tally,
        steps: usize,
        mut look: impl FnMut(&Situation<'_>, &Controller),
    ) -> Tally {
        let road = self.scenario.road.clone();
        let settings = &self.conditions.control.safety;
        let broken = self.conditions.broken;
        let excuses_nothing = matches!(broken, Some(Broken::CutIn | Broken::Revealed));
        let mut watch = Watch::new(settings, &road, self.scenario.cast.len(), excuses_nothing);
        watch.tally = tally;
        let mut monitor = Monitor::new(*settings);
        let mut s_m = road.to_frenet(self.plant.state.pose.position()).s_m;
        for step in 0..steps {
            let ego = TrueVehicle::new(
                VehicleId(EGO_ID),
                VehicleKind::Cav,
                EGO,
                self.plant.state,
                s_m,
                &road,
            );
            s_m = ego.frenet.s_m;
            let truths: Vec<TrueVehicle> = self
                .scenario
                .cast
                .iter()
                .map(|cast| cast.other.truth(&road))
                .collect();
            self.look_ahead(step, &ego, &truths, &road);
            self.estimate(step, &road);
            let sight = self.sight(step, &ego, &truths, &road);
            let output = self.control(step, &ego, &sight, &mut look);
            let manoeuvre = self.controller.manoeuvre();
            let judged = Judged {
                step,
                ego: &ego,
                manoeuvre,
                output: &output,
            };
            let seen = self.seen(step, &truths);
            watch.observe(&judged, &seen);
            if self.conditions.is_monitored {
                self.show(&mut monitor, step, &ego, &truths, &sight, &output, &road);
            }
            self.advance(step, &ego, &truths, manoeuvre, &output, &road);
        }
        let mut tally = watch.tally;
        tally.add_causes(&monitor);
        tally
    }

    /// Who is in sight, and who has been for long enough to be known.
    fn look_ahead(&mut self, step: usize, ego: &TrueVehicle, truths: &[TrueVehicle], road: &Road) {
        let end_m = ego.frenet.s_m + self.scenario.sight_range_m;
        for (index, truth) in truths.iter().enumerate() {
            let cast = &self.scenario.cast[index];
            let hidden = || {
                truths.iter().enumerate().any(|(nearer, other)| {
                    nearer != index
                        && other.s_range_m[0] > ego.s_range_m[1]
                        && other.s_range_m[1] < truth.s_range_m[0]
                        && !other
                            .lanes(road, 0.0)
                            .shared_with(truth.lanes(road, 0.0))
                            .is_empty()
                })
            };
            let in_sight = truth.s_range_m[0] < end_m && !hidden();
            let since = &mut self.in_sight_since[index];
            *since = in_sight.then_some(since.unwrap_or(step));
            let seen =
                since.is_some_and(|since| since == 0 || step >= since + self.scenario.delay_steps);
            self.is_known[index] |= (cast.is_shared || seen) && !cast.is_missed;
        }
    }

    fn estimate(&mut self, step: usize, road: &Road) {
        let settings = &self.conditions.control.safety;
        self.tracks.clear();
        self.neighbours.clear();
        for (index, cast) in self.scenario.cast.iter().enumerate() {
            if !self.is_known[index] {
                continue;
            }
            let track = self.scenario.estimate.track(
                index,
                &cast.other,
                step,
                road,
                settings,
                &mut self.dice,
            );
            let neighbour = self.scenario.estimate.neighbour(&track, road, settings);
            self.neighbours.extend(neighbour);
            self.tracks.push(PlacedTrack::new(track, road));
        }
    }

    /// The true ends of free sight, said to lie up to the bound beyond: where each lane is free or
    /// hidden only behind known vehicles, and where the nearest vehicle is, known or not.
    fn sight(
        &self,
        step: usize,
        ego: &TrueVehicle,
        truths: &[TrueVehicle],
        road: &Road,
    ) -> SightLine {
        let farthest_m = ego.frenet.s_m + self.scenario.sight_range_m;
        let mut clear_s_m = [farthest_m; LANE_COUNT as usize];
        let mut open_s_m = clear_s_m;
        for (index, truth) in truths.iter().enumerate() {
            let rear_m = truth.s_range_m[0];
            let is_noticed = self.in_sight_since[index].is_some()
                && !self.scenario.cast[index].is_missed
                && rear_m > ego.s_range_m[1];
            if !is_noticed {
                continue;
            }
            let lanes = truth.lanes(road, 0.0);
            for (place, lane) in LaneIndex::all().enumerate() {
                if lanes.contains(lane) {
                    open_s_m[place] = open_s_m[place].min(rear_m);
                    if !self.is_known[index] {
                        clear_s_m[place] = clear_s_m[place].min(rear_m);
                    }
                }
            }
        }
        let said = |ends: [f64; LANE_COUNT as usize]| {
            ends.map(|end_m| end_m + self.scenario.sight_error_m)
        };
        SightLine::new(said(clear_s_m), time_s(step)).with_open(said(open_s_m))
    }

    fn control(
        &mut self,
        step: usize,
        ego: &TrueVehicle,
        sight: &SightLine,
        look: &mut impl FnMut(&Situation<'_>, &Controller),
    ) -> ControlOutput {
        let (state, frenet) = self.plant.told(ego.frenet, &self.scenario.road);
        let situation = Situation {
            profile: &self.scenario.profile,
            ego: EgoState {
                station: STATION,
                state,
                dimensions: EGO,
                frenet,
            },
            neighbours: &self.neighbours,
            sight,
            time_s: time_s(step),
            desired_speed_mps: TOP_MPS,
        };
        if step.is_multiple_of(DECISION_STEPS) {
            if step.is_multiple_of(WISH_STEPS) && !self.scenario.wishes.is_empty() {
                let wishes = &self.scenario.wishes;
                self.wish = wishes[self.dice.random_range(0..wishes.len())];
            }
            let wish = self.wish;
            let action = [wish, Action::KeepLane]
                .into_iter()
                .find(|action| self.controller.verdict(&situation, *action) == ActionVerdict::Safe)
                .unwrap_or(Action::EmergencyStop);
            self.controller.set_action(action, situation.time_s);
        }
        look(&situation, &self.controller);
        let target = self.controller.manoeuvre().destination();
        let input = self.scenario.nominal.input(
            step,
            &ego.frenet,
            ego.speed_mps,
            EGO.wheelbase_m,
            self.scenario.road.lane_center_m(target),
            &mut self.dice,
        );
        match input {
            Some(u_nominal) => self.controller.filter(&situation, u_nominal),
            None => self.controller.control(&situation),
        }
    }

    fn seen(&self, step: usize, truths: &[TrueVehicle]) -> Vec<Seen> {
        let age = self.scenario.estimate.age_steps(step);
        let of = |id: u32| self.neighbours.iter().find(|neighbour| neighbour.id == id);
        let cast = self.scenario.cast.iter().zip(truths).enumerate();
        cast.map(|(index, (cast, truth))| Seen {
            truth: *truth,
            speed_mps: cast.other.now.speed_mps,
            is_visible: self.in_sight_since[index].is_some() || self.is_known[index],
            known: of(cast.other.id).copied(),
            measured: self.is_known[index]
                .then(|| step.checked_sub(age))
                .flatten(),
            follows: matches!(cast.other.script, Script::Follow { .. }),
        })
        .collect()
    }

    #[expect(
        clippy::too_many_arguments,
        reason = "all that the monitor may see of one step"
    )]
    fn show(
        &self,
        monitor: &mut Monitor,
        step: usize,
        ego: &TrueVehicle,
        truths: &[TrueVehicle],
        sight: &SightLine,
        output: &ControlOutput,
        road: &Road,
    ) {
        let time_s = time_s(step);
        for (truth, since) in truths.iter().zip(&self.in_sight_since) {
            monitor.sight(ego.id, truth.id, since.is_some(), time_s);
        }
        let mut all = Vec::with_capacity(truths.len() + 1);
        all.push(*ego);
        all.extend_from_slice(truths);
        let view = CavView {
            id: ego.id,
            tracks: &self.tracks,
            sight: Some(sight),
            manoeuvre: self.controller.manoeuvre(),
            state: self.plant.state,
            wheelbase_m: EGO.wheelbase_m,
            input: Some(output.u),
        };
        monitor.observe(time_s, road, &all, &[view], []);
    }

    fn advance(
        &mut self,
        step: usize,
        ego: &TrueVehicle,
        truths: &[TrueVehicle],
        manoeuvre: Manoeuvre,
        output: &ControlOutput,
        road: &Road,
    ) {
        let off_m = ego.frenet.d_m - road.lane_center_m(manoeuvre.destination());
        let disturbance = self.scenario.noise.draw(step, off_m, &mut self.dice);
        self.plant
            .step(output.u, disturbance, &self.conditions.noise);
        let settings = &self.conditions.control.safety;
        let set = SafeSet { settings, road };
        let target = manoeuvre.destination();
        let wanted = match manoeuvre {
            Manoeuvre::KeepLane { .. } => None,
            _ => Some(road.lane_center_m(target)),
        };
        let announced = (settings.announcement_s / STEP_S).round() as usize;
        let mut own = ego.lanes(road, 0.0);
        if let Manoeuvre::ChangeLane { to, .. } = manoeuvre {
            own = own.with(to);
        }
        let cast = self.scenario.cast.iter_mut().zip(truths);
        for ((Cast { other, .. }, truth), since) in cast.zip(&mut self.merging_since) {
            let lane = truth.lane.filter(|lane| own.contains(*lane));
            let lane = lane.filter(|_| truth.is_behind(ego));
            *since = lane.map(|_| since.unwrap_or(step));
            let merging = lane.zip(*since).map(|(lane, since)| Merging {
                since_s: time_s(step - since),
                gap_m: set.gap_behind_m(ego, lane, truth.s_range_m[1]),
                ego_stop_m: set.shortest_stop_m(ego.speed_mps),
                keep_m: set.keep_m(ego, truth.dimensions.length_m),
            });
            other.announce(step, announced, wanted);
            other.step(step, road, merging, &mut self.dice);
        }
    }
}

/// Time of a step.
fn time_s(step: usize) -> f64 {
    step as f64 * STEP_S
}
