use covista_perception::PerceiveError;
use covista_sensors::{Lidar, RayScene, Viewpoint};
use covista_world::{Calibration, Percept};
use rayon::prelude::*;

use super::super::perception::Frame;
use crate::{Networks, senses::measure};

/// What both networks find in the picture and the sweep of each CAV, as in the demo.
#[derive(Clone)]
pub(crate) struct Rendered {
    networks: Networks,
    lidar: Lidar,
}

impl Rendered {
    /// By these networks.
    pub fn new(networks: Networks) -> Self {
        Self {
            networks,
            lidar: Lidar::hdl64e(),
        }
    }

    /// Every CAV looks, on all threads: `percepts` are those of each.
    ///
    /// # Errors
    /// When a network fails.
    pub fn look(
        &self,
        frame: &Frame<'_>,
        calibration: &Calibration,
        percepts: &mut [Vec<Percept>],
    ) -> Result<(), PerceiveError> {
        let looks = percepts.par_iter_mut().enumerate();
        looks.try_for_each(|(index, percepts)| {
            *percepts = self.look_from(index, frame, calibration)?;
            Ok(())
        })
    }

    /// CAV `index` looks at everybody's images nearest to it.
    fn look_from(
        &self,
        index: usize,
        frame: &Frame<'_>,
        calibration: &Calibration,
    ) -> Result<Vec<Percept>, PerceiveError> {
        let ([eye_s_m, _], _) = frame.sights.about(index);
        let scene = frame.ring.scene_near(eye_s_m);
        let view = Viewpoint {
            scene: &scene,
            rays: &RayScene::new(&scene),
            ego: &scene.vehicles[index],
            calibration,
        };
        let measured = measure(&view, &self.lidar, frame.ring.settings().seed);
        Ok(self.networks.perceive(&measured, calibration)?.percepts)
    }
}

#[cfg(test)]
mod tests;
