use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::Viewpoint;
use crate::testing::{EGO, empty_road};

fn plain(width: usize, height: usize, value: f32) -> Radiance {
    Radiance {
        width,
        pixels: vec![Rgb::repeat(value); width * height],
        depth_m: vec![10.0; width * height],
    }
}

/// A camera that adds nothing to what it sees.
fn ideal() -> CameraSettings {
    CameraSettings {
        vignetting: 0.0,
        read_noise: 0.0,
        shot_noise: 0.0,
        motion_blur_s: 0.0,
        lens_spread: 0.0,
        saturation: 1.0,
        ..CameraSettings::default()
    }
}

fn expose(picture: &Radiance, settings: &CameraSettings) -> Vec<u8> {
    let white = Rgb::repeat(1.0);
    picture.expose(white, settings, &Motion::default(), 7).rgb
}

#[test]
fn noise_has_mean_zero_and_variance_one() {
    let draws: Vec<f32> = (0..200)
        .flat_map(|row| {
            let mut noise = Noise::new(1, row);
            (0..100).flat_map(move |_| noise.three())
        })
        .collect();
    let mean = draws.iter().sum::<f32>() / draws.len() as f32;
    let variance = draws.iter().map(|x| x * x).sum::<f32>() / draws.len() as f32;
    assert!(
        mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03,
        "{mean} {variance}"
    );
}

#[test]
fn more_exposure_is_brighter_and_vignetting_darkens_the_corners() {
    let picture = plain(64, 32, 0.3);
    let middle = |settings| expose(&picture, &settings)[3 * (16 * 64 + 32)];
    let brighter = CameraSettings {
        exposure_ev: 1.0,
        ..ideal()
    };
    assert!(middle(brighter) > middle(ideal()) + 20);
    let vignetted = expose(
        &picture,
        &CameraSettings {
            vignetting: 0.4,
            ..ideal()
        },
    );
    assert!(vignetted[0] + 20 < middle(ideal()));
    assert!(vignetted[3 * (16 * 64 + 32)].abs_diff(middle(ideal())) <= 1);
}

#[test]
fn driving_draws_points_out_away_from_the_vanishing_point() {
    let mut scene = empty_road();
    scene.vehicles[0].state.speed_mps = 30.0;
    let (rays, calibration) = (
        crate::RayScene::new(&scene),
        covista_world::Calibration::kitti(),
    );
    let view = Viewpoint::new(&scene, &rays, EGO, &calibration).expect("the ego");
    let motion = Motion::new(&view);
    let mut picture = plain(1242, 375, 0.0);
    let bright = 300 * 1242 + 610;
    picture.pixels[bright] = Rgb::repeat(4.0);
    // At 10 m the row 127 px below the horizon moves 30 m/s * 10 ms / 10 m * 127 px = 3.8 px.
    let settings = CameraSettings {
        motion_blur_s: 0.01,
        ..ideal()
    };
    let moved = picture.expose(Rgb::repeat(1.0), &settings, &motion, 1).rgb;
    let lit: Vec<usize> = (0..375 * 1242).filter(|i| moved[3 * i] > 60).collect();
    assert!((3..=5).contains(&lit.len()), "{lit:?}");
    assert!(
        lit.iter()
            .all(|i| i % 1242 == 610 && (298..=302).contains(&(i / 1242)))
    );
    picture.depth_m.fill(f32::INFINITY);
    let still = picture.expose(Rgb::repeat(1.0), &settings, &motion, 1).rgb;
    assert_eq!((0..375 * 1242).filter(|i| still[3 * i] > 0).count(), 1);
}

#[test]
fn a_bonnet_covers_the_lower_edge_only() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let bonnet = std::iter::repeat_with(|| CameraSettings::draw(&mut rng).bonnet)
        .flatten()
        .next();
    let picture = plain(200, 100, 2.0);
    let (with, without) = (CameraSettings { bonnet, ..ideal() }, ideal());
    let (with, without) = (expose(&picture, &with), expose(&picture, &without));
    assert_eq!(with[..3 * 200 * 85], without[..3 * 200 * 85]);
    let at = 3 * (99 * 200 + 100);
    assert!(with[at] + 60 < without[at]);
}

#[test]
fn settings_survive_a_file() {
    let settings = CameraSettings {
        jpeg_quality: Some(80),
        bonnet: Some(Bonnet {
            height: 0.1,
            arch: 0.25,
            middle: 0.5,
            color: [0.1, 0.05, 0.025],
            gloss: 0.5,
        }),
        ..CameraSettings::default()
    };
    let text = serde_json::to_string(&settings).expect("a text");
    let read: CameraSettings = serde_json::from_str(&text).expect("settings");
    assert_eq!(read, settings);
    let some: CameraSettings = serde_json::from_str(r#"{"gamma": 1.1}"#).expect("settings");
    assert!(some.lens_spread > 0.0 && some.gamma > 1.0);
    assert!(serde_json::from_str::<CameraSettings>(r#"{"exposure": 1}"#).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn any_settings_make_the_same_picture_on_any_number_of_threads(
        seed in any::<u64>(),
        (width, height) in (1..70_usize, 1..40_usize),
        value in prop_oneof![0.0..3.0_f32, Just(1e30)],
        wild in any::<f64>(),
        (field, quality) in (0..9_usize, any::<Option<u8>>()),
    ) {
        let mut settings = CameraSettings::draw(&mut ChaCha8Rng::seed_from_u64(seed));
        settings.jpeg_quality = quality;
        let fields = [
            &mut settings.exposure_ev, &mut settings.vignetting, &mut settings.read_noise,
            &mut settings.shot_noise, &mut settings.motion_blur_s, &mut settings.lens_spread,
            &mut settings.contrast, &mut settings.gamma, &mut settings.saturation,
        ];
        if let Some(changed) = fields.into_iter().nth(field) {
            *changed = wild;
        }
        let picture = plain(width, height, value);
        let [one, two] = [1, 2].map(|count| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
            pool.expect("a pool").install(|| expose(&picture, &settings))
        });
        prop_assert_eq!(one.len(), 3 * width * height);
        prop_assert!(one == two);
    }
}
