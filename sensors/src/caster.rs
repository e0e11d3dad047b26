//! Rays against the truth: vehicles and scenery as convex hulls under one bounding-volume
//! hierarchy, and the ground.

use std::sync::{Arc, OnceLock};

use covista_traffic::{Material, Scene, SceneVehicle, Terrain, VehicleId, VehicleModel};
use nalgebra::{Point3, Vector3};

use crate::bvh::{Bounds, Bvh};
use crate::fan::Fan;
use crate::hull::Hull;
use crate::part::{Entry, Face, Part};

/// By how much the bounds of a part reach beyond it, against rounding.
const MARGIN_M: f32 = 1e-3;
/// The same per metre from the world's origin.
const ROUNDING: f32 = 1e-6;

/// What a ray hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ObjectRef {
    /// A vehicle.
    Vehicle(VehicleId),
    /// A body of the scenery, by its index in the scene.
    Scenery(usize),
}

/// Where a ray meets a surface first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray in metres.
    pub distance_m: f32,
    /// Unit normal of the surface in the world frame, towards the outside.
    pub normal: Vector3<f32>,
    /// What the surface is made of, with the vehicle's own paint.
    pub material: Material,
    /// Whose surface it is.
    pub object: ObjectRef,
}

/// What a ray of a fan meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Distance to the ground, whatever stands before it.
    pub ground_m: Option<f32>,
    /// The first surface before the ground.
    pub hit: Option<Hit>,
}

/// A convex part in the world frame with its outline.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Solid<'a> {
    pub(crate) part: &'a Part,
    pub(crate) faces: &'a [Face],
    pub(crate) vertices: &'a [Point3<f32>],
}

/// A scene made ready for ray casting, in the world frame.
#[derive(Debug, Clone)]
pub struct RayScene {
    terrain: Arc<Terrain>,
    parts: Vec<Part>,
    faces: Vec<Face>,
    /// The vertices of each part.
    vertices: Vec<Box<[Point3<f32>]>>,
    bvh: Bvh,
    half_turn_s: f32,
}

impl RayScene {
    /// Prepares the vehicles and the scenery of `scene`, frozen at its time.
    pub fn new(scene: &Scene) -> Self {
        Self::rolling(scene, 0.0)
    }

    /// Prepares `scene` for rays up to `half_turn_s` seconds before and after its time, through
    /// which the vehicles go on straight ahead at their speed.
    pub fn rolling(scene: &Scene, half_turn_s: f64) -> Self {
        let mut rays = Self {
            terrain: Arc::clone(&scene.terrain),
            parts: Vec::new(),
            faces: Vec::new(),
            vertices: Vec::new(),
            bvh: Bvh::default(),
            half_turn_s: if half_turn_s.is_finite() {
                half_turn_s.abs() as f32
            } else {
                0.0
            },
        };
        let mut bounds = Vec::new();
        for vehicle in &scene.vehicles {
            let pose = scene.placed(vehicle);
            let velocity_mps = pose * Vector3::x() * vehicle.state.speed_mps;
            for hull in model_hulls(vehicle.model) {
                let hull = hull.scaled(&vehicle.scale).transformed(&pose);
                bounds.push(rays.add(ObjectRef::Vehicle(vehicle.id), &hull, velocity_mps));
                if let Some(part) = rays.parts.last_mut() {
                    part.material = painted(part.material, vehicle);
                }
            }
        }
        for (index, body) in scene.scenery.iter().enumerate() {
            for hull in body.parts.iter().filter_map(Hull::new) {
                bounds.push(rays.add(ObjectRef::Scenery(index), &hull, Vector3::zeros()));
            }
        }
        rays.bvh = Bvh::new(&bounds);
        rays
    }

    /// Memory that it takes, the ground left out, in bytes.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.parts)
            + size_of_val(&*self.faces)
            + self
                .vertices
                .iter()
                .map(|corners| size_of_val(&**corners))
                .sum::<usize>()
            + size_of_val(&*self.vertices)
            + self.bvh.memory_bytes()
    }

    fn add(&mut self, object: ObjectRef, hull: &Hull, velocity_mps: Vector3<f64>) -> Bounds {
        let anchor = hull.vertices[0].cast::<f32>();
        let velocity_mps = velocity_mps.cast::<f32>();
        let first_face = self.faces.len() as u32;
        let about = anchor.cast::<f64>();
        self.faces
            .extend(hull.faces.iter().map(|face| face.about(&about)));
        self.parts.push(Part {
            anchor,
            velocity_mps,
            first_face,
            end_face: self.faces.len() as u32,
            material: hull.material,
            object,
        });
        let vertices: Box<_> = hull.vertices.iter().map(|vertex| vertex.cast()).collect();
        let (low, high) = vertices.iter().fold(
            (Vector3::repeat(f32::MAX), Vector3::repeat(f32::MIN)),
            |(low, high), vertex| (low.inf(&vertex.coords), high.sup(&vertex.coords)),
        );
        self.vertices.push(vertices);
        let way = velocity_mps.abs() * self.half_turn_s;
        let margin = way.add_scalar(MARGIN_M + ROUNDING * low.amax().max(high.amax()));
        Bounds {
            low: low - margin,
            high: high + margin,
        }
    }

    /// All convex parts at the scene's time.
    pub(crate) fn solids(&self) -> impl Iterator<Item = Solid<'_>> {
        let parts = self.parts.iter().zip(&self.vertices);
        parts.map(|(part, vertices)| Solid {
            part,
            faces: &self.faces[part.first_face as usize..part.end_face as usize],
            vertices,
        })
    }

    /// The first surface that the ray from `origin` along the unit vector `direction` meets within
    /// `max_m` metres. `skip` is looked through, as is every part that holds the origin.
    pub fn cast(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
        skip: Option<VehicleId>,
    ) -> Option<Hit> {
        self.cast_at(origin, direction, max_m, skip, 0.0)
    }

    /// As [`Self::cast`], `dt_s` after the scene's time: at most `half_turn_s` of
    /// [`Self::rolling`].
    pub fn cast_at(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
        skip: Option<VehicleId>,
        dt_s: f32,
    ) -> Option<Hit> {
        let dt_s = self.within_turn(dt_s);
        let skip = skip.map(ObjectRef::Vehicle);
        let mut reach_m = max_m;
        let mut nearest: Option<(&Part, Entry)> = None;
        self.bvh.along_ray(origin, direction, max_m, |leaf| {
            let part = &self.parts[leaf as usize];
            if Some(part.object) == skip {
                return reach_m;
            }
            let from = part.local(origin, dt_s);
            if let Some(entry) = part.entry(&self.faces, &from, direction, reach_m)
                && nearest.is_none_or(|(_, known)| entry.is_before(&known))
            {
                reach_m = entry.distance_m;
                nearest = Some((part, entry));
            }
            reach_m
        });
        nearest.map(|(part, entry)| self.hit(part, entry))
    }

    /// What each ray of a fan from one `origin` meets, `dt_s` after the scene's time.
    ///
    /// The same, bit by bit, as [`Self::ground_hit`] and [`Self::cast_at`] as far as the ground,
    /// and fast where the `directions` lie close together or in one plane.
    pub fn cast_fan(
        &self,
        origin: &Point3<f32>,
        directions: &[Vector3<f32>],
        max_m: f32,
        skip: Option<VehicleId>,
        dt_s: f32,
    ) -> Vec<Sighting> {
        let mut grounds = Vec::with_capacity(directions.len());
        let ground = |way| self.ground_hit(origin, way, max_m);
        grounds.extend(directions.iter().map(ground));
        let reaches = grounds.iter().map(|ground_m| ground_m.unwrap_or(max_m));
        let rays: Vec<_> = directions.iter().copied().zip(reaches).collect();
        let single = |&(way, reach_m): &_| self.cast_at(origin, &way, reach_m, skip, dt_s);
        let hits: Vec<_> = if let Some(mut fan) = Fan::new(origin, &rays) {
            let skip = skip.map(ObjectRef::Vehicle);
            let dt_s = self.within_turn(dt_s);
            fan.cast(&self.bvh, &self.parts, &self.faces, skip, dt_s);
            let hit = |(part, entry)| self.hit(&self.parts[part as usize], entry);
            (0..rays.len()).map(|ray| fan.met(ray).map(hit)).collect()
        } else {
            rays.iter().map(single).collect()
        };
        let sightings = grounds.into_iter().zip(hits);
        sightings
            .map(|(ground_m, hit)| Sighting { ground_m, hit })
            .collect()
    }

    /// Distance along the ray to the ground, where it lies ahead within `max_m`.
    pub fn ground_hit(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
    ) -> Option<f32> {
        if self.terrain.is_flat() {
            let distance_m = -origin.z / direction.z;
            return (direction.z < 0.0 && distance_m > 0.0 && distance_m <= max_m)
                .then_some(distance_m);
        }
        let (origin, direction) = (origin.cast::<f64>(), direction.cast::<f64>());
        let distance_m = self.terrain.meet(&origin, &direction, f64::from(max_m))?;
        Some(distance_m as f32)
    }

    /// A time to which the bounds of the parts hold.
    fn within_turn(&self, dt_s: f32) -> f32 {
        dt_s.clamp(-self.half_turn_s, self.half_turn_s)
    }

    fn hit(&self, part: &Part, entry: Entry) -> Hit {
        let [x, y, z, _] = self.faces[entry.face as usize];
        Hit {
            distance_m: entry.distance_m,
            normal: Vector3::new(x, y, z),
            material: part.material,
            object: part.object,
        }
    }

    /// Whether anything but `skip` stands within `max_m` metres along the ray.
    pub fn occluded(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
        skip: Option<VehicleId>,
    ) -> bool {
        self.blocked(origin, direction, max_m, |object| {
            Some(object) != skip.map(ObjectRef::Vehicle)
        })
    }

    /// Whether the ray meets the part of this number within `max_m` metres.
    pub(crate) fn is_met(
        &self,
        part: u32,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
    ) -> bool {
        let part = &self.parts[part as usize];
        let from = part.local(origin, 0.0);
        part.entry(&self.faces, &from, direction, max_m).is_some()
    }

    /// Whether any object that `blocks` stands within `max_m` metres along the ray.
    pub(crate) fn blocked(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
        blocks: impl Fn(ObjectRef) -> bool,
    ) -> bool {
        let mut hit = false;
        self.bvh.along_ray(origin, direction, max_m, |leaf| {
            let part = &self.parts[leaf as usize];
            let from = part.local(origin, 0.0);
            hit = hit
                || blocks(part.object)
                    && part.entry(&self.faces, &from, direction, max_m).is_some();
            // Nothing is left to be seen once something blocks.
            if hit { f32::MIN } else { max_m }
        });
        hit
    }
}

/// The hulls of a model in the vehicle frame, built once.
fn model_hulls(model: VehicleModel) -> &'static [Hull] {
    static HULLS: [OnceLock<Vec<Hull>>; VehicleModel::ALL.len()] =
        [const { OnceLock::new() }; VehicleModel::ALL.len()];
    HULLS[model as usize].get_or_init(|| model.body().parts.iter().filter_map(Hull::new).collect())
}

fn painted(material: Material, vehicle: &SceneVehicle) -> Material {
    match material {
        Material::CarPaint(_) => Material::CarPaint(vehicle.paint),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use covista_world::Se2Pose;
    use proptest::prelude::*;

    use super::*;
    use crate::testing::{EGO, block, empty_road, vehicle};

    const LOW: [f64; 3] = [4.0, -3.0, 0.0];
    const HIGH: [f64; 3] = [9.0, 2.0, 2.5];

    fn block_scene() -> RayScene {
        let mut scene = empty_road();
        scene.vehicles.clear();
        scene.scenery = vec![block(LOW, HIGH)].into();
        RayScene::new(&scene)
    }

    /// Entry into and exit from the block by Kay and Kajiya's slabs.
    fn slabs(origin: [f64; 3], direction: [f64; 3]) -> (f64, f64) {
        (0..3).fold((f64::MIN, f64::MAX), |(enter, exit), axis| {
            let to = |plane: f64| (plane - origin[axis]) / direction[axis];
            let (a, b) = (to(LOW[axis]), to(HIGH[axis]));
            (enter.max(a.min(b)), exit.min(a.max(b)))
        })
    }

    proptest! {
        #[test]
        fn a_block_is_hit_where_its_slabs_say(
            origin in [-20.0..20.0_f64, -20.0..20.0, 3.0..20.0],
            target in [2.0..11.0_f64, -5.0..4.0, 0.0..4.0],
        ) {
            let direction = (Vector3::from(target) - Vector3::from(origin)).normalize();
            let (enter, exit) = slabs(origin, direction.into());
            // A ray that grazes an edge may go either way in single precision.
            prop_assume!((exit - enter).abs() > 0.01);
            let rays = block_scene();
            let (from, along) = (Point3::from(origin).cast::<f32>(), direction.cast::<f32>());
            let found = rays.cast(&from, &along, 100.0, None);
            prop_assert_eq!(found.is_some(), 0.0 < enter && enter < exit);
            prop_assert_eq!(rays.occluded(&from, &along, 100.0, None), found.is_some());
            if let Some(hit) = found {
                prop_assert!((f64::from(hit.distance_m) - enter).abs() < 1e-3);
                prop_assert!(hit.normal.dot(&along) < 0.0);
                prop_assert_eq!(hit.object, ObjectRef::Scenery(0));
            }
        }
    }

    #[test]
    fn the_ground_is_a_plane() {
        let eye = Point3::new(1.0, 2.0, 1.73);
        let down = Vector3::new(0.6, 0.0, -0.8);
        let distance = block_scene()
            .ground_hit(&eye, &down, 120.0)
            .expect("ground");
        assert!((distance - 1.73 / 0.8).abs() < 1e-6);
        assert!(block_scene().ground_hit(&eye, &-down, 120.0).is_none());
        assert!(block_scene().ground_hit(&eye, &down, 2.0).is_none());
        assert!(
            block_scene()
                .ground_hit(&eye, &Vector3::x(), 120.0)
                .is_none()
        );
    }

    #[test]
    fn a_vehicle_is_hit_at_its_bumper_with_its_own_paint_and_can_be_skipped() {
        let mut scene = empty_road();
        let other = VehicleId(7);
        let pose = Se2Pose::new(20.0, 0.0, 0.0);
        scene
            .vehicles
            .push(vehicle(other, VehicleModel::Truck, pose));
        let rays = RayScene::new(&scene);
        // Into the rear of the cargo box, 1.96 m behind the rear axle.
        let eye = Point3::new(0.0, 0.5, 2.0);
        let hit = rays
            .cast(&eye, &Vector3::x(), 100.0, Some(EGO))
            .expect("the truck");
        assert!((hit.distance_m - 18.04).abs() < 1e-4, "{hit:?}");
        assert_eq!(hit.object, ObjectRef::Vehicle(other));
        assert_eq!(hit.material, Material::CarPaint([200, 200, 200]));
        assert!((hit.normal + Vector3::x()).norm() < 1e-5);
        assert!(rays.cast(&eye, &Vector3::x(), 100.0, Some(other)).is_none());
        assert!(rays.cast(&eye, &Vector3::x(), 18.0, Some(EGO)).is_none());
    }

    #[test]
    fn a_ray_from_inside_looks_out() {
        let inside = Point3::new(6.0, 0.0, 1.0);
        assert!(
            block_scene()
                .cast(&inside, &Vector3::x(), 100.0, None)
                .is_none()
        );
    }

    #[test]
    fn an_empty_scene_is_hit_nowhere() {
        let mut scene = empty_road();
        scene.vehicles.clear();
        let rays = RayScene::new(&scene);
        assert!(
            rays.cast(&Point3::origin(), &Vector3::x(), 100.0, None)
                .is_none()
        );
        assert!(!rays.occluded(&Point3::origin(), &Vector3::x(), 100.0, None));
    }
}
