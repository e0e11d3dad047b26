use std::collections::BTreeMap;

use covista_traffic::{RingSettings, Scenario};
use serde::{Deserialize, Serialize};

use super::{
    Behaviour, Case, Experiment, ExperimentError, LoopCase, NetworkedGame, Percepts, Policies,
    SceneCase, Seeds, TrainingCase, TruncationCase, training_case, training_of,
};
use crate::{
    ControlMode, ControlSettings, RingEnvironmentSettings, RingPerception, environment::BEHAVIOUR_S,
};

/// Behaviour steps of an episode: the paper's 40,000 steps of 0.01 s.
pub(super) const STEPS: u64 = 800;
/// Those of the headway's curve: 250 s, of which the paper shows the first 500 time steps.
const HEADWAY_STEPS: u64 = 500;
/// Vehicles on the loop, and the CAVs among them at the paper's CAV ratio of 0.6.
const VEHICLES: usize = 30;
const CAVS: usize = 18;
const SCENARIO: &str = "obstacle-at-corner";
/// Vehicles of the games whose global Q is computed: 2^10 joint states with 2^10 joint actions.
const RING_VEHICLES: usize = 10;
/// gamma: a short sight, the paper's, and that of the shipped policies.
const DISCOUNTS: [f64; 3] = [0.5, 0.9, 0.99];

/// What may be chosen about an experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExperimentOptions {
    /// Every case is driven once for each.
    pub seeds: Seeds,
    /// Behaviour steps of an episode, 0.5 s each; `None` for the experiment's own length.
    pub steps: Option<u64>,
    /// Where the CAVs' percepts come from, in a scenario and on the loop.
    pub percepts: Percepts,
    /// Decisions of each learner of a training.
    pub decisions: u64,
}

/// An experiment with everything that its outcome depends on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Which one.
    pub experiment: Experiment,
    /// The version of covista that drives it.
    pub version: String,
    /// What was chosen.
    pub options: ExperimentOptions,
    /// SHA-256 of the policies' files.
    pub policies: BTreeMap<Behaviour, String>,
    /// SHA-256 of the networks that percepts come from, by their ids.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub networks: BTreeMap<String, String>,
    /// The trainings that were given for their learning curves; without any, they are made.
    pub trainings: Vec<TrainingCase>,
}

impl Plan {
    /// The experiment with these options, policies and SHA-256 of networks by their ids.
    ///
    /// # Errors
    /// When an option makes no sense, networks are missing or a policy does not fit the loop.
    pub fn new(
        experiment: Experiment,
        options: ExperimentOptions,
        policies: &Policies,
        networks: BTreeMap<String, String>,
        trainings: Vec<TrainingCase>,
    ) -> Result<Self, ExperimentError> {
        if options.steps == Some(0) {
            return Err(ExperimentError::NoSteps);
        }
        if options.percepts == Percepts::Network && networks.is_empty() {
            return Err(ExperimentError::NoNetworks);
        }
        let plan = Self {
            experiment,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            options,
            policies: policies.hashes(),
            networks,
            trainings,
        };
        let cases = plan.cases()?;
        if experiment == Experiment::EpisodeReward {
            plan.check_trainings(&cases)?;
        }
        let with_cavs = cases.iter().find_map(|case| match case {
            Case::Loop(case) if case.environment.ring.cavs > 0 => Some(case.environment),
            _ => None,
        });
        if let Some(settings) = with_cavs {
            policies.check(settings.shape())?;
        }
        Ok(plan)
    }

    /// Its cases, in the order of its table.
    ///
    /// # Errors
    /// When the scenario cannot be built.
    pub fn cases(&self) -> Result<Vec<Case>, ExperimentError> {
        let behaviours = self.experiment.behaviours();
        Ok(match self.experiment {
            Experiment::CavRatio => {
                let ratios = (1..=VEHICLES / 5).map(|index| 5 * index);
                let density = RingSettings::default().density;
                let humans = self.loops(Behaviour::Idm, 0, density, STEPS);
                let mixed = behaviours.iter().flat_map(|&behaviour| {
                    let of = move |cavs| self.loops(behaviour, cavs, density, STEPS);
                    ratios.clone().flat_map(of)
                });
                humans.chain(mixed).map(Case::Loop).collect()
            }
            Experiment::Density => self.by_density().map(Case::Loop).collect(),
            Experiment::Safety => {
                let exploring = self.by_density().map(|case| LoopCase {
                    explores: true,
                    ..case
                });
                self.by_density().chain(exploring).map(Case::Loop).collect()
            }
            Experiment::Headway => {
                let all = behaviours.iter();
                all.flat_map(|&behaviour| self.loops(behaviour, CAVS, 0.6, HEADWAY_STEPS))
                    .map(Case::Loop)
                    .collect()
            }
            Experiment::ActionDesign => {
                let all = behaviours.iter();
                let density = RingSettings::default().density;
                all.flat_map(|&behaviour| self.loops(behaviour, CAVS, density, STEPS))
                    .map(Case::Loop)
                    .collect()
            }
            Experiment::EpisodeReward => self.trainings_made().map(Case::Training).collect(),
            Experiment::ObstacleAtCorner => self.scenes()?,
            Experiment::Truncation => self.games().collect(),
        })
    }

    fn seeds(&self) -> std::ops::RangeInclusive<u64> {
        self.options.seeds.first..=self.options.seeds.last
    }

    fn by_density(&self) -> impl Iterator<Item = LoopCase> + '_ {
        let behaviours = self.experiment.behaviours().iter();
        behaviours.flat_map(move |&behaviour| {
            densities().flat_map(move |rho| self.loops(behaviour, CAVS, rho, STEPS))
        })
    }

    fn loops(
        &self,
        behaviour: Behaviour,
        cavs: usize,
        density: f64,
        steps: u64,
    ) -> impl Iterator<Item = LoopCase> + '_ {
        let mut environment = RingEnvironmentSettings {
            steps: self.options.steps.unwrap_or(steps),
            ends_at_collision: behaviour.may_leave_the_road(),
            watched: matches!(
                self.experiment,
                Experiment::Safety | Experiment::ActionDesign
            ),
            sharing: behaviour.shares(),
            reward: training_case::reward(),
            ..RingEnvironmentSettings::default()
        };
        environment.ring.vehicles = VEHICLES;
        environment.ring.cavs = if behaviour == Behaviour::Idm { 0 } else { cavs };
        environment.ring.density = density;
        if behaviour != Behaviour::Idm {
            environment.perception = self.options.percepts.on_ring();
        }
        if !behaviour.is_filtered() {
            environment.control.mode = ControlMode::Off;
        }
        let policy_sha256 = self.policies.get(&behaviour).cloned();
        self.seeds().map(move |seed| {
            let mut environment = environment;
            environment.ring.seed = seed;
            LoopCase {
                behaviour,
                policy_sha256: policy_sha256.clone(),
                networks: self.networks_of(environment.perception == RingPerception::Network),
                environment,
                explores: false,
                keeps_headways: self.experiment == Experiment::Headway,
                keeps_motion: self.experiment == Experiment::ActionDesign,
            }
        })
    }

    fn scenes(&self) -> Result<Vec<Case>, ExperimentError> {
        let own_s = Scenario::builtin(SCENARIO)?.duration_s;
        let asked_s = self.options.steps.map(|steps| steps as f64 * BEHAVIOUR_S);
        let of = |sharing: bool| {
            self.seeds().map(move |seed| {
                Case::Scene(SceneCase {
                    scenario: SCENARIO.to_owned(),
                    percepts: self.options.percepts,
                    networks: self.networks_of(self.options.percepts == Percepts::Network),
                    sharing,
                    seed,
                    duration_s: asked_s.unwrap_or(own_s),
                    control: ControlSettings::default(),
                })
            })
        };
        Ok(of(true).chain(of(false)).collect())
    }

    /// The networks, where a case uses them.
    fn networks_of(&self, uses: bool) -> BTreeMap<String, String> {
        if uses {
            self.networks.clone()
        } else {
            BTreeMap::new()
        }
    }

    fn games(&self) -> impl Iterator<Item = Case> {
        let traffic = self.seeds().map(|seed| NetworkedGame::Traffic { seed });
        let games: Vec<_> = traffic.chain([NetworkedGame::Relay]).collect();
        DISCOUNTS.into_iter().flat_map(move |discount| {
            let case = move |game| TruncationCase {
                game,
                vehicles: RING_VEHICLES,
                discount,
            };
            let cases: Vec<_> = games
                .iter()
                .map(|&game| Case::Truncation(case(game)))
                .collect();
            cases
        })
    }

    fn trainings_made(&self) -> Box<dyn Iterator<Item = TrainingCase> + '_> {
        if !self.trainings.is_empty() {
            return Box::new(self.trainings.iter().cloned());
        }
        let behaviours = self.experiment.behaviours().iter();
        Box::new(behaviours.flat_map(move |&behaviour| {
            self.seeds().filter_map(move |seed| {
                Some(TrainingCase {
                    config: training_of(behaviour, self.options.steps, seed)?,
                    decisions: self.options.decisions,
                })
            })
        }))
    }

    /// Both algorithms must be there, learning the same from as much, and no training twice.
    fn check_trainings(&self, cases: &[Case]) -> Result<(), ExperimentError> {
        let mut names: Vec<String> = cases.iter().map(Case::name).collect();
        for behaviour in self.experiment.behaviours() {
            let name = behaviour.name();
            if !names
                .iter()
                .any(|case| case.starts_with(&format!("{name}-seed")))
            {
                return Err(ExperimentError::Trainings(format!(
                    "there is no training of {name} among those given; give one of ours and one of maddpg with --trained"
                )));
            }
        }
        if let Some((one, other)) = self
            .trainings
            .iter()
            .zip(self.trainings.iter().skip(1))
            .find(|(one, other)| !one.is_comparable(other))
        {
            let [one, other] = [one, other].map(|case| Case::Training(case.clone()).name());
            return Err(ExperimentError::Trainings(format!(
                "{one} and {other} had other traffic, rewards, networks or numbers of decisions; give trainings that differ in algorithm, filter and seed only with --trained"
            )));
        }
        names.sort_unstable();
        match names.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(twice) => Err(ExperimentError::Trainings(format!(
                "{} is given twice; give trainings of different seeds with --trained",
                twice[0]
            ))),
            None => Ok(()),
        }
    }
}

/// The paper's densities, 0.1 to 0.9.
pub(super) fn densities() -> impl Iterator<Item = f64> + Clone {
    (1..=9).map(|tenths| f64::from(tenths) / 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan_with(
        experiment: Experiment,
        percepts: Percepts,
        networks: BTreeMap<String, String>,
    ) -> Result<Plan, ExperimentError> {
        let options = ExperimentOptions {
            seeds: Seeds::default(),
            steps: None,
            percepts,
            decisions: 20_000,
        };
        let policies = Policies::default();
        Plan::new(experiment, options, &policies, networks, Vec::new())
    }

    fn plan(experiment: Experiment) -> Plan {
        plan_with(experiment, Percepts::Truth, BTreeMap::new()).expect("a plan")
    }

    #[test]
    fn percepts_of_networks_are_those_of_certain_networks() {
        let of = |networks| plan_with(Experiment::ObstacleAtCorner, Percepts::Network, networks);
        let none = of(BTreeMap::new());
        assert!(matches!(none, Err(ExperimentError::NoNetworks)), "{none:?}");
        let networks = BTreeMap::from([("pointpillars".to_owned(), "0".repeat(64))]);
        let plan = of(networks.clone()).expect("a plan");
        for case in plan.cases().expect("cases") {
            let Case::Scene(case) = case else {
                panic!("no scene: {case:?}");
            };
            assert_eq!(case.networks, networks);
        }
    }

    #[test]
    fn every_case_has_a_name_of_its_own() {
        for (experiment, count) in Experiment::ALL
            .into_iter()
            .zip([155, 135, 180, 10, 10, 15, 10, 18])
        {
            let cases = plan(experiment).cases().expect("cases");
            let mut names: Vec<_> = cases.iter().map(Case::name).collect();
            assert_eq!(names.len(), count, "{experiment:?}");
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), count, "{experiment:?}");
        }
    }

    #[test]
    fn percepts_with_errors_are_named_and_of_no_concern_to_human_drivers() {
        let exact = plan(Experiment::CavRatio);
        let mut statistical = exact.clone();
        statistical.options.percepts = Percepts::Statistical;
        let pairs =
            (exact.cases().expect("cases").into_iter()).zip(statistical.cases().expect("cases"));
        for (exact, other) in pairs {
            let Case::Loop(case) = &other else {
                panic!("no loop: {other:?}");
            };
            let is_human = case.behaviour == Behaviour::Idm;
            assert_eq!(exact == other, is_human);
            assert_eq!(other.name().ends_with("-statistical"), !is_human);
            let is_exact = case.environment.perception == RingPerception::Exact;
            assert_eq!(is_exact, is_human);
        }
    }

    #[test]
    fn only_maddpg_alone_and_who_may_leave_the_road_drive_without_the_filter() {
        let experiments = [Experiment::Density, Experiment::ActionDesign];
        let cases = experiments.map(|experiment| plan(experiment).cases().expect("cases"));
        for case in cases.into_iter().flatten() {
            let Case::Loop(case) = case else {
                panic!("no loop: {case:?}");
            };
            let is_off = case.environment.control.mode == ControlMode::Off;
            let steers_alone = case.behaviour == Behaviour::EndToEndUnfiltered;
            assert_eq!(
                is_off,
                case.behaviour == Behaviour::Maddpg || steers_alone,
                "{case:?}"
            );
            assert_eq!(case.environment.ends_at_collision, steers_alone);
            assert_eq!(
                case.environment.ring.cavs == 0,
                case.behaviour == Behaviour::Idm
            );
        }
    }

    #[test]
    fn learning_curves_of_one_algorithm_are_no_comparison() {
        let mut given = plan(Experiment::EpisodeReward);
        given.trainings = given.trainings_made().take(2).collect();
        let error = given
            .check_trainings(&given.cases().expect("cases"))
            .expect_err("refused");
        assert!(
            error.to_string().contains("no training of maddpg"),
            "{error}"
        );
    }
}
