//! A photograph of any camera in the lane network's view, and pixels back.

use covista_world::{Calibration, CameraImage, CameraIntrinsics};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// The part of a photograph that the lane network looks at: its full width, turned upright, with
/// the horizon in the row where KITTI's camera has it.
///
/// Scaling keeps the field of view, so the network sees a focal length of `fx * width of the view /
/// width of the photograph`; it was trained on a range of them.
#[derive(Debug, Clone, PartialEq)]
pub struct LaneView {
    photograph: CameraIntrinsics,
    view: CameraIntrinsics,
    photograph_from_view: UnitQuaternion<f64>,
}

impl LaneView {
    /// The view of `size_px` (across, down) in photographs of a camera, or `None` where the camera
    /// looks straight up or down and so at no horizon.
    pub fn new(camera: &Calibration, size_px: [u32; 2]) -> Option<Self> {
        let [width_px, height_px] = size_px;
        let photograph = camera.intrinsics;
        let mounting = camera.vehicle_from_camera.rotation;
        let forward = mounting * Vector3::z();
        let level = forward.xy().norm();
        if level < 1e-6 {
            return None;
        }
        let right = Vector3::new(forward.y, -forward.x, 0.0) / level;
        let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
        let upright = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let scale = f64::from(width_px) / f64::from(photograph.width_px);
        let focal_px = scale * photograph.fx_px;
        Some(Self {
            photograph,
            view: CameraIntrinsics {
                width_px,
                height_px,
                fx_px: focal_px,
                fy_px: focal_px,
                cx_px: (photograph.cx_px + 0.5) * scale - 0.5,
                // A camera that looks up has the horizon below its optical axis.
                cy_px: CameraIntrinsics::KITTI.cy_px - focal_px * forward.z / level,
            },
            photograph_from_view: mounting.inverse() * upright,
        })
    }

    /// The view of a photograph, bilinear, black where the photograph doesn't reach.
    pub fn cut(&self, photograph: &CameraImage) -> CameraImage {
        let (width_px, height_px) = (self.view.width_px, self.view.height_px);
        let pixels = (0..height_px).flat_map(|v| (0..width_px).map(move |u| [u, v].map(f64::from)));
        let rgb = pixels.flat_map(|pixel| {
            let place = self.in_photograph(pixel);
            place
                .and_then(|place| sample(photograph, place))
                .unwrap_or_default()
        });
        CameraImage {
            width_px,
            height_px,
            rgb: rgb.collect(),
        }
    }

    /// The pixel (u, v) of the photograph that a pixel of the view shows; it may lie outside.
    pub fn in_photograph(&self, [u_px, v_px]: [f64; 2]) -> Option<[f64; 2]> {
        let ray = self.photograph_from_view * self.view.ray(u_px, v_px);
        self.photograph.project(&ray.into())
    }

    /// The pixel (u, v) of the view that shows a pixel of the photograph; it may lie outside.
    pub fn in_view(&self, [u_px, v_px]: [f64; 2]) -> Option<[f64; 2]> {
        let ray = self.photograph_from_view.inverse() * self.photograph.ray(u_px, v_px);
        self.view.project(&ray.into())
    }
}

/// The colour at (u, v), or `None` outside of the image. Whole numbers are the centres of pixels.
fn sample(image: &CameraImage, place: [f64; 2]) -> Option<[u8; 3]> {
    let size = [image.width_px, image.height_px];
    let inside = |side: usize| (-0.5..=f64::from(size[side]) - 0.5).contains(&place[side]);
    if !(inside(0) && inside(1)) {
        return None;
    }
    let [(left, right, across), (above, below, down)] = [0, 1].map(|side| {
        let last = size[side].saturating_sub(1);
        let at = place[side].clamp(0.0, f64::from(last));
        let low = at as u32;
        (low, (low + 1).min(last), at - f64::from(low))
    });
    let channel = |u: u32, v: u32, channel: usize| {
        let index = 3 * (v as usize * image.width_px as usize + u as usize) + channel;
        image.rgb.get(index).map(|&value| f64::from(value))
    };
    let mut colour = [0; 3];
    for (index, value) in colour.iter_mut().enumerate() {
        let row = |v| {
            Some(mix(
                channel(left, v, index)?,
                channel(right, v, index)?,
                across,
            ))
        };
        *value = mix(row(above)?, row(below)?, down).round() as u8;
    }
    Some(colour)
}

fn mix(low: f64, high: f64, share: f64) -> f64 {
    low + share * (high - low)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector2};

    use super::*;

    const SIZE_PX: [u32; 2] = [1242, 375];
    const WINDSCREEN: &str = include_str!("../../../assets/calibration/windscreen-1280x720.toml");

    fn windscreen(tilt: &str) -> Calibration {
        let lines = WINDSCREEN.lines().filter(|line| !line.starts_with("pitch"));
        let text: String = lines.map(|line| format!("{line}\n")).collect();
        let text = text.replace("[lidar]", &format!("{tilt}\n[lidar]"));
        Calibration::parse(&text, "windscreen").expect("a calibration")
    }

    fn picture(size: [u32; 2], colour: impl Fn(f64, f64) -> u8) -> CameraImage {
        let [width_px, height_px] = size;
        let pixels = (0..height_px).flat_map(|v| (0..width_px).map(move |u| (u, v)));
        CameraImage {
            width_px,
            height_px,
            rgb: pixels
                .flat_map(|(u, v)| [colour(f64::from(u), f64::from(v)), 40, 90])
                .collect(),
        }
    }

    #[test]
    fn kittis_own_picture_stays_as_it_is() {
        let view = LaneView::new(&Calibration::kitti(), SIZE_PX).expect("a horizon");
        let image = picture(SIZE_PX, |u, v| ((7.0 * u + 3.0 * v) % 256.0) as u8);
        assert_eq!(view.cut(&image), image);
    }

    #[test]
    fn an_upright_camera_is_cropped_and_scaled_about_its_horizon() {
        let camera = windscreen("pitch_deg = 3.0");
        let view = LaneView::new(&camera, SIZE_PX).expect("a horizon");
        let scale = 1242.0 / 1280.0;
        let camera = camera.intrinsics;
        let horizon_px = camera.cy_px + camera.fy_px * 3.0_f64.to_radians().tan();
        for pixel in [[0.0, 0.0], [620.0, 172.854], [1241.0, 374.0], [33.3, 250.0]] {
            let [u, v] = view.in_photograph(pixel).expect("in front");
            assert!((u - ((pixel[0] + 0.5) / scale - 0.5)).abs() < 1e-6, "{u}");
            assert!((v - horizon_px - (pixel[1] - 172.854) / scale).abs() < 1e-6);
        }
    }

    #[test]
    fn the_horizon_of_any_tilt_is_level_in_kittis_row() {
        for tilt in [
            "pitch_deg = -6.0",
            "roll_deg = 4.0\npitch_deg = 5.0\nyaw_deg = -8.0",
        ] {
            let camera = windscreen(tilt);
            let view = LaneView::new(&camera, SIZE_PX).expect("a horizon");
            for u in [0.0, 400.0, 1241.0] {
                let [u, v] = view.in_photograph([u, 172.854]).expect("in front");
                let ray = camera.vehicle_from_camera * camera.intrinsics.ray(u, v);
                assert!(ray.z.abs() < 1e-9, "{tilt}: {ray}");
            }
        }
    }

    #[test]
    fn a_line_on_the_road_is_found_where_the_photograph_has_it() {
        let camera = windscreen("roll_deg = -3.0\npitch_deg = 2.0\nyaw_deg = 1.0");
        let view = LaneView::new(&camera, SIZE_PX).expect("a horizon");
        let vehicle = camera.vehicle_from_camera.inverse();
        let [near, far] = [6.0, 60.0].map(|x| {
            let point = vehicle * Point3::new(x, 1.8, 0.0);
            let [u, v] = camera.intrinsics.project(&point).expect("in front");
            Vector2::new(u, v)
        });
        let along = (far - near).normalize();
        let beside = |u: f64, v: f64| {
            let offset = Vector2::new(u, v) - near;
            along.x * offset.y - along.y * offset.x
        };
        // A soft line, 6 px wide.
        let image = picture([1280, 720], |u, v| {
            (255.0 * (1.0 - beside(u, v).abs() / 6.0).max(0.0)) as u8
        });
        let cut = view.cut(&image);
        for row in [200_u32, 240, 280, 320] {
            let red = |u: u32| f64::from(cut.rgb[3 * (row * 1242 + u) as usize]);
            let total: f64 = (0..1242).map(red).sum();
            let middle = (0..1242).map(|u| f64::from(u) * red(u)).sum::<f64>() / total;
            assert!(total > 255.0, "row {row}: {total}");
            let [u, v] = view
                .in_photograph([middle, f64::from(row)])
                .expect("in front");
            assert!(beside(u, v).abs() < 0.5, "row {row}: {}", beside(u, v));
            let [back_u, back_v] = view.in_view([u, v]).expect("in front");
            assert!((back_u - middle).abs() < 1e-6 && (back_v - f64::from(row)).abs() < 1e-6);
        }
    }

    #[test]
    fn what_the_photograph_lacks_is_black_and_no_horizon_is_no_view() {
        let camera = windscreen("pitch_deg = -15.0");
        let view = LaneView::new(&camera, SIZE_PX).expect("a horizon");
        let cut = view.cut(&picture([1280, 720], |_, _| 200));
        assert_eq!(cut.rgb[..3], [0; 3]);
        assert_eq!(cut.rgb[cut.rgb.len() - 3..], [200, 40, 90]);
        assert_eq!(
            LaneView::new(&windscreen("pitch_deg = 90.0"), SIZE_PX),
            None
        );
    }
}
