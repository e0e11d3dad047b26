use covista_perception::{Detector, metrics::TrueBox};
use covista_sensors::kitti::{
    KittiFrame, KittiLabel, picture_box_px, read_cloud, read_image, read_labels,
};
use covista_world::{Calibration, CameraIntrinsics, Detection3d, ObjectClass, PointCloud};
use nalgebra::{Point3, Vector3};

use crate::evaluate::{EvaluateError, file_of};
use crate::recorded::calibration_of;

/// Average precision needs less sure boxes, too, than one would act upon.
const LEAST_SCORE: f64 = 0.05;
/// A true box with fewer returns neither counts nor makes a detection of it wrong.
const LEAST_RETURNS: usize = 5;
const DONT_CARE: &str = "DontCare";

/// One frame's labels and the boxes found in it, in the LIDAR frame.
pub(super) struct MeasuredFrame {
    pub(super) calibration: Calibration,
    pub(super) objects: Vec<Object>,
    /// Down to [`LEAST_SCORE`], the surest first.
    pub(super) found: Vec<Detection3d>,
    /// left, top, right, bottom in pixels of `DontCare` regions.
    dont_care_px: Vec<[f64; 4]>,
}

/// A label of a vehicle, or of a kind that the detector doesn't know (`Tram`, `Misc`).
pub(super) struct Object {
    pub(super) label: KittiLabel,
    /// Where it is; its score has no meaning, nor has its class where that isn't known.
    pub(super) shape: Detection3d,
    pub(super) is_known: bool,
    pub(super) in_range: bool,
    /// Points of the sweep in its box.
    pub(super) returns: usize,
}

impl MeasuredFrame {
    /// Reads the files of a frame and runs the detector on its sweep: one that looks ahead only on
    /// the points in the picture, as is the custom with KITTI.
    pub(super) fn read(frame: &KittiFrame, detector: &mut Detector) -> Result<Self, EvaluateError> {
        let mut calibration = calibration_of(frame)?;
        if let Some(path) = &frame.image {
            let image = read_image(path)?;
            calibration.intrinsics.width_px = image.width_px;
            calibration.intrinsics.height_px = image.height_px;
        }
        let sweep = read_cloud(file_of(&frame.cloud)?)?;
        let labels = read_labels(file_of(&frame.labels)?)?;
        let range_m = detector.range_m().map(f64::from);
        if range_m[0] < 0.0 {
            let found = detector.detect_down_to(&sweep, LEAST_SCORE)?;
            return Ok(Self::new(labels, found, calibration, &sweep, &range_m));
        }
        let seen = in_picture(&sweep, &calibration);
        let found = detector.detect_down_to(&seen, LEAST_SCORE)?;
        let mut frame = Self::new(labels, found, calibration, &sweep, &range_m);
        for object in &mut frame.objects {
            object.in_range &= object.is_in_picture();
        }
        Ok(frame)
    }

    fn new(
        labels: Vec<KittiLabel>,
        found: Vec<Detection3d>,
        calibration: Calibration,
        sweep: &PointCloud,
        range_m: &[f64; 6],
    ) -> Self {
        let regions = labels.iter().filter(|label| label.kind == DONT_CARE);
        Self {
            dont_care_px: regions.map(|region| region.bbox_px).collect(),
            objects: labels
                .into_iter()
                .filter_map(|label| Object::new(label, &calibration, sweep, range_m))
                .collect(),
            found,
            calibration,
        }
    }

    pub(super) fn is_labelled_before_the_camera(&self) -> bool {
        let mut depths_m = self.objects.iter().map(|object| object.label.location_m[2]);
        depths_m.all(|z_m| z_m > 0.0)
    }

    /// The boxes found of a class that are to be right or wrong: with `picture_only` those whose
    /// centres the picture shows, and none in a `DontCare` region.
    pub(super) fn found_all_around(
        &self,
        class: ObjectClass,
        picture_only: bool,
    ) -> Vec<Detection3d> {
        let camera = &self.calibration.intrinsics;
        let camera_from_lidar = self.calibration.camera_from_lidar();
        let is_cared_for = |[u, v]: [f64; 2]| {
            !self.dont_care_px.iter().any(|[left, top, right, bottom]| {
                (*left..=*right).contains(&u) && (*top..=*bottom).contains(&v)
            })
        };
        let counts = |found: &&Detection3d| {
            let pixel = camera.project(&(camera_from_lidar * Point3::from(found.center_m)));
            match pixel {
                Some(pixel) if is_inside(camera, pixel) => is_cared_for(pixel),
                _ => !picture_only,
            }
        };
        let of_class = self.found.iter().filter(|found| found.class == class);
        of_class.filter(counts).copied().collect()
    }

    /// The true boxes for a class: those of others, out of range, more than so occluded or with
    /// hardly a return are ignored.
    pub(super) fn true_boxes(&self, class: ObjectClass, most_occluded: u8) -> Vec<TrueBox> {
        let of = |object: &Object| TrueBox {
            footprint: object.shape,
            ignored: !object.is_of(class)
                || !object.in_range
                || object.returns < LEAST_RETURNS
                || object.label.occluded > most_occluded,
        };
        self.objects.iter().map(of).collect()
    }

    /// Height in pixels of what the picture shows of a found box.
    pub(super) fn height_px(&self, found: &Detection3d) -> Option<f64> {
        let [_, top, _, bottom] = picture_box_px(&corners_m(found), &self.calibration)?;
        Some(bottom - top)
    }
}

/// The points of a sweep that the picture shows.
pub(crate) fn in_picture(sweep: &PointCloud, calibration: &Calibration) -> PointCloud {
    let camera_from_lidar = calibration.camera_from_lidar();
    let is_seen = |[x, y, z, _]: &[f32; 4]| {
        let point = camera_from_lidar * Point3::new(*x, *y, *z).cast::<f64>();
        let pixel = calibration.intrinsics.project(&point);
        pixel.is_some_and(|pixel| is_inside(&calibration.intrinsics, pixel))
    };
    PointCloud {
        points: sweep.points.iter().copied().filter(is_seen).collect(),
    }
}

impl Object {
    /// `None` for what the detector must not report, people and cyclists, and for regions.
    fn new(
        label: KittiLabel,
        calibration: &Calibration,
        sweep: &PointCloud,
        range_m: &[f64; 6],
    ) -> Option<Self> {
        let class = match label.kind.as_str() {
            "Car" => Some(ObjectClass::Car),
            "Van" | "Truck" => Some(ObjectClass::Truck),
            "Pedestrian" | "Person_sitting" | "Cyclist" | DONT_CARE => return None,
            _ => None,
        };
        let [height, width, length] = label.size_hwl_m;
        let (center_m, yaw_rad) = label.pose_in_lidar(calibration);
        let shape = Detection3d {
            center_m,
            size_m: Vector3::new(length, width, height),
            yaw_rad,
            class: class.unwrap_or(ObjectClass::Truck),
            score: 1.0,
        };
        let is_within = |axis: usize| (range_m[axis]..=range_m[axis + 3]).contains(&center_m[axis]);
        Some(Self {
            is_known: class.is_some(),
            in_range: (0..2).all(is_within),
            returns: returns_on(&shape, sweep),
            shape,
            label,
        })
    }

    pub(super) fn is_of(&self, class: ObjectClass) -> bool {
        self.is_known && self.shape.class == class
    }

    /// Height of its 2D box in pixels: 0 outside the picture.
    pub(super) fn height_px(&self) -> f64 {
        let [_, top, _, bottom] = self.label.bbox_px;
        bottom - top
    }

    /// Whether the picture shows some of it.
    pub(super) fn is_in_picture(&self) -> bool {
        self.label.location_m[2] > 0.0 && self.height_px() > 0.0
    }

    /// From the LIDAR, over the ground.
    pub(super) fn distance_m(&self) -> f64 {
        self.shape.center_m.xy().norm()
    }
}

fn is_inside(camera: &CameraIntrinsics, [u, v]: [f64; 2]) -> bool {
    (0.0..f64::from(camera.width_px)).contains(&u)
        && (0.0..f64::from(camera.height_px)).contains(&v)
}

fn corners_m(of: &Detection3d) -> [Point3<f64>; 8] {
    let (sin, cos) = of.yaw_rad.sin_cos();
    std::array::from_fn(|corner| {
        let side = |axis: usize| if corner >> axis & 1 == 0 { -0.5 } else { 0.5 };
        let [along, across, up] = [0, 1, 2].map(|axis| side(axis) * of.size_m[axis]);
        let turned = Vector3::new(cos * along - sin * across, sin * along + cos * across, up);
        Point3::from(of.center_m + turned)
    })
}

fn returns_on(shape: &Detection3d, sweep: &PointCloud) -> usize {
    let (sin, cos) = shape.yaw_rad.sin_cos();
    let half = shape.size_m / 2.0;
    let is_on = |[x, y, z, _]: &&[f32; 4]| {
        let offset = Vector3::new(f64::from(*x), f64::from(*y), f64::from(*z)) - shape.center_m;
        let along = cos * offset.x + sin * offset.y;
        let across = -sin * offset.x + cos * offset.y;
        along.abs() <= half.x && across.abs() <= half.y && offset.z.abs() <= half.z
    };
    sweep.points.iter().filter(is_on).count()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn detection(x: f64, y: f64) -> Detection3d {
        Detection3d {
            center_m: Vector3::new(x, y, -0.9),
            size_m: Vector3::new(4.0, 1.8, 1.6),
            yaw_rad: 0.0,
            class: ObjectClass::Car,
            score: 0.9,
        }
    }

    /// A frame of KITTI's camera with these labels and boxes; ten returns lie on a car 20 m ahead.
    pub fn frame(labels: &[&str], found: Vec<Detection3d>) -> MeasuredFrame {
        let labels = labels.iter().map(|text| text.parse().expect("a label"));
        let sweep = PointCloud {
            points: vec![[20.27, 0.0, -0.8, 0.3]; 10],
        };
        let range_m = [-69.0, -12.0, -3.0, 69.0, 12.0, 1.0];
        MeasuredFrame::new(
            labels.collect(),
            found,
            Calibration::kitti(),
            &sweep,
            &range_m,
        )
    }

    /// 20.27 m ahead of the LIDAR.
    pub const CAR: &str = "Car 0 0 0 600 150 650 200 1.6 1.8 4.0 0.0 1.65 20.0 -1.57";

    #[test]
    fn boxes_in_dont_care_regions_or_outside_the_picture_are_left_out() {
        let region = "DontCare -1 -1 -10 500 160 560 220 -1 -1 -1 -1000 -1000 -1000 -10";
        let found = || {
            vec![
                detection(20.0, 0.0),
                detection(20.0, 2.5),
                detection(-20.0, 0.0),
            ]
        };
        // 2.5 m to the left at 20 m is at u = 518.
        let kitti = frame(&[CAR, region], found());
        assert!(kitti.is_labelled_before_the_camera());
        let counted = kitti.found_all_around(ObjectClass::Car, true);
        assert_eq!(counted, [detection(20.0, 0.0)]);

        let behind = CAR.replace(" 20.0 ", " -20.0 ");
        let all_around = frame(&[CAR, &behind], found());
        assert!(!all_around.is_labelled_before_the_camera());
        let counted = all_around.found_all_around(ObjectClass::Car, false);
        assert_eq!(counted.len(), 3);
        assert!(
            all_around
                .found_all_around(ObjectClass::Truck, false)
                .is_empty()
        );
    }

    #[test]
    fn people_are_no_boxes_and_unknown_kinds_are_ignored() {
        use ObjectClass::{Car, Truck};
        let ignored = |kind: &str, z: &str, class| {
            let line = CAR.replace("Car", kind).replace("20.0", z);
            let boxes = frame(&[&line], Vec::new()).true_boxes(class, 1);
            boxes.first().map(|truth| truth.ignored)
        };
        assert_eq!(ignored("Car", "20.0", Car), Some(false));
        assert_eq!(ignored("Car", "20.0", Truck), Some(true));
        assert_eq!(ignored("Van", "20.0", Truck), Some(false));
        assert_eq!(ignored("Tram", "20.0", Truck), Some(true));
        // No returns there.
        assert_eq!(ignored("Car", "30.0", Car), Some(true));
        for kind in ["Pedestrian", "Cyclist", "Person_sitting", "DontCare"] {
            assert_eq!(ignored(kind, "20.0", Car), None);
        }
    }

    #[test]
    fn heights_in_the_picture_are_those_of_the_boxes() {
        let frame = frame(&[CAR], Vec::new());
        // The near face is 18 m before the LIDAR, 17.73 m before the camera, and 1.6 m high; the
        // roof's far edge is seen a little above its near one.
        let height_px = frame
            .height_px(&detection(20.0, 0.0))
            .expect("in the picture");
        assert!(
            (height_px - 721.5377 * 1.6 / 17.73).abs() < 0.2,
            "{height_px}"
        );
        assert_eq!(frame.height_px(&detection(-20.0, 0.0)), None);
        assert_eq!(frame.height_px(&detection(10.0, 20.0)), None);
        // Beside the camera: cut off at both borders.
        let height_px = frame.height_px(&detection(1.0, 2.0));
        assert!(height_px.is_some_and(|px| px <= 374.0), "{height_px:?}");
    }
}
