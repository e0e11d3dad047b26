use covista_perception::{FramePercepts, PerceiveError};
use covista_sensors::{Lidar, RayScene, Viewpoint};
use covista_world::{Calibration, FreeSpace, Percept};
use rayon::prelude::*;

use super::super::perception::Frame;
use crate::{Networks, senses::measure};

/// What both networks find in the picture and the sweep of each CAV, as in the demo.
#[derive(Clone)]
pub(crate) struct Rendered {
    networks: Networks,
    lidar: Lidar,
    /// Of each CAV, as of the newest frame.
    free_spaces: Vec<FreeSpace>,
}

impl Rendered {
    /// By these networks.
    pub fn new(networks: Networks) -> Self {
        Self {
            networks,
            lidar: Lidar::hdl64e(),
            free_spaces: Vec::new(),
        }
    }

    /// How far the sweep of CAV `index` reached.
    pub fn free_space(&self, index: usize) -> Option<&FreeSpace> {
        self.free_spaces.get(index)
    }

    /// Every CAV looks, on all threads: `percepts` are those of each.
    ///
    /// # Errors
    /// When a network fails.
    pub fn look(
        &mut self,
        frame: &Frame<'_>,
        calibration: &Calibration,
        percepts: &mut [Vec<Percept>],
    ) -> Result<(), PerceiveError> {
        let looks = (0..percepts.len()).into_par_iter();
        let found = looks.map(|index| self.look_from(index, frame, calibration));
        let found = found.collect::<Result<Vec<_>, _>>()?;
        self.free_spaces.clear();
        for (percepts, found) in percepts.iter_mut().zip(found) {
            *percepts = found.percepts;
            self.free_spaces.push(found.free_space);
        }
        Ok(())
    }

    /// CAV `index` looks at everybody's images nearest to it.
    fn look_from(
        &self,
        index: usize,
        frame: &Frame<'_>,
        calibration: &Calibration,
    ) -> Result<FramePercepts, PerceiveError> {
        let scene = frame.ring.scene_near(frame.cavs[index].frenet.s_m);
        let view = Viewpoint {
            scene: &scene,
            rays: &RayScene::new(&scene),
            ego: &scene.vehicles[index],
            calibration,
        };
        let measured = measure(&view, &self.lidar, frame.ring.settings().seed);
        self.networks.perceive(&measured, calibration)
    }
}

#[cfg(test)]
mod tests;
