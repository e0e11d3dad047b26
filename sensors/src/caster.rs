//! Rays against the truth: vehicles and scenery as convex hulls under one bounding-volume
//! hierarchy. The ground is the plane z = 0 and is found by [`ground_hit`].

use std::sync::OnceLock;

use covista_traffic::{Material, Scene, SceneVehicle, VehicleId, VehicleModel};
use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, TraversalAction};
use parry3d::query::{Ray, RayCast};

use crate::hull::Hull;

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

/// A convex part in the world frame: a run of the scene's half-spaces.
#[derive(Debug, Clone, Copy)]
struct Part {
    first_face: u32,
    end_face: u32,
    material: Material,
    object: ObjectRef,
}

/// A scene made ready for ray casting, in the world frame.
#[derive(Debug, Clone)]
pub struct RayScene {
    parts: Vec<Part>,
    /// Half-spaces n . p <= offset: n and the offset.
    faces: Vec<[f32; 4]>,
    bvh: Bvh,
}

/// Distance along the ray to the ground plane z = 0, where it lies ahead within `max_m`.
pub fn ground_hit(origin: &Point3<f32>, direction: &Vector3<f32>, max_m: f32) -> Option<f32> {
    let distance_m = -origin.z / direction.z;
    (direction.z < 0.0 && distance_m > 0.0 && distance_m <= max_m).then_some(distance_m)
}

impl RayScene {
    /// Prepares the vehicles and the scenery of `scene`.
    pub fn new(scene: &Scene) -> Self {
        let vehicles = scene.vehicles.iter().flat_map(|vehicle| {
            let pose = scene.placed(vehicle);
            model_hulls(vehicle.model).iter().map(move |hull| {
                let mut hull = hull.scaled(&vehicle.scale).transformed(&pose);
                hull.material = painted(hull.material, vehicle);
                (ObjectRef::Vehicle(vehicle.id), hull)
            })
        });
        let scenery = scene.scenery.iter().enumerate().flat_map(|(index, body)| {
            let hulls = body.parts.iter().filter_map(Hull::new);
            hulls.map(move |hull| (ObjectRef::Scenery(index), hull))
        });
        Self::from_hulls(vehicles.chain(scenery))
    }

    fn from_hulls(hulls: impl Iterator<Item = (ObjectRef, Hull)>) -> Self {
        let (mut parts, mut faces, mut bounds) = (Vec::new(), Vec::new(), Vec::new());
        for (object, hull) in hulls {
            let first_face = faces.len() as u32;
            faces.extend(hull.faces.iter().map(|face| face.to_f32()));
            parts.push(Part {
                first_face,
                end_face: faces.len() as u32,
                material: hull.material,
                object,
            });
            let corners = hull.vertices.iter();
            bounds.push(Aabb::from_points(corners.map(|vertex| {
                Vector::new(vertex.x as f32, vertex.y as f32, vertex.z as f32)
            })));
        }
        Self {
            parts,
            faces,
            bvh: Bvh::from_leaves(BvhBuildStrategy::Binned, &bounds),
        }
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
        let ray = parry_ray(origin, direction);
        let skip = skip.map(ObjectRef::Vehicle);
        let (leaf, distance_m) = self.bvh.cast_ray(&ray, max_m, |leaf, nearest_m| {
            let part = &self.parts[leaf as usize];
            if Some(part.object) == skip {
                return None;
            }
            self.entry(part, origin, direction, nearest_m)
                .map(|(distance_m, _)| distance_m)
        })?;
        let part = self.parts[leaf as usize];
        let (_, face) = self.entry(&part, origin, direction, f32::MAX)?;
        let [x, y, z, _] = self.faces[face];
        Some(Hit {
            distance_m,
            normal: Vector3::new(x, y, z),
            material: part.material,
            object: part.object,
        })
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

    /// Whether any object that `blocks` stands within `max_m` metres along the ray.
    pub(crate) fn blocked(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
        blocks: impl Fn(ObjectRef) -> bool,
    ) -> bool {
        let ray = parry_ray(origin, direction);
        let mut hit = false;
        self.bvh.traverse(|node| {
            if !node.aabb().intersects_local_ray(&ray, max_m) {
                return TraversalAction::Prune;
            }
            let Some(leaf) = node.leaf_data() else {
                return TraversalAction::Continue;
            };
            let part = &self.parts[leaf as usize];
            hit = blocks(part.object) && self.entry(part, origin, direction, max_m).is_some();
            if hit {
                TraversalAction::EarlyExit
            } else {
                TraversalAction::Prune
            }
        });
        hit
    }

    /// Distance at which the ray enters `part` within `max_m` and through which face.
    ///
    /// The ray is clipped by one half-space after the other.
    fn entry(
        &self,
        part: &Part,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        max_m: f32,
    ) -> Option<(f32, usize)> {
        let (mut enter_m, mut exit_m) = (0.0_f32, max_m);
        let mut through = None;
        for face in part.first_face as usize..part.end_face as usize {
            let [x, y, z, offset_m] = self.faces[face];
            let gap = offset_m - (x * origin.x + y * origin.y + z * origin.z);
            let slope = x * direction.x + y * direction.y + z * direction.z;
            if slope < 0.0 {
                let distance_m = gap / slope;
                if distance_m > enter_m {
                    enter_m = distance_m;
                    through = Some(face);
                }
            } else if gap < 0.0 {
                return None;
            } else if slope > 0.0 {
                exit_m = exit_m.min(gap / slope);
            }
            if enter_m >= exit_m {
                return None;
            }
        }
        through.map(|face| (enter_m, face))
    }
}

fn parry_ray(origin: &Point3<f32>, direction: &Vector3<f32>) -> Ray {
    Ray::new(
        Vector::new(origin.x, origin.y, origin.z),
        Vector::new(direction.x, direction.y, direction.z),
    )
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
        let distance = ground_hit(&eye, &down, 120.0).expect("ground");
        assert!((distance - 1.73 / 0.8).abs() < 1e-6);
        assert!(ground_hit(&eye, &-down, 120.0).is_none());
        assert!(ground_hit(&eye, &down, 2.0).is_none());
        assert!(ground_hit(&eye, &Vector3::x(), 120.0).is_none());
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
