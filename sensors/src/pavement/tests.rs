use covista_traffic::{MarkStyle, PaintColor, Scene};
use nalgebra::Vector2;
use proptest::prelude::*;

use super::*;
use crate::testing::{empty_road, light};

fn patch(s_m: f64, d_m: f64, spread_m: f64) -> GroundPatch {
    GroundPatch {
        position: Vector2::new(s_m - 200.0, d_m),
        s_m,
        d_m,
        spread_s_m: spread_m,
        spread_d_m: spread_m,
    }
}

/// Fresh paint on a sound road whose second mark from the left has this style.
fn freshly_painted(style: MarkStyle) -> Scene {
    let mut scene = empty_road();
    scene.look.paint_wear = 0.0;
    scene.markings.styles[1] = style;
    scene
}

/// Percentage of paint at distances to the left of the second mark.
fn paint_across<const N: usize>(scene: &Scene, from_mark_m: [f64; N]) -> [u8; N] {
    let paint = Paint::new(scene, 1);
    from_mark_m.map(|offset_m| {
        let patch = patch(100.0, 1.75 + offset_m, 0.002);
        let share = paint.cover(&patch, 0.002).map_or(0.0, |(_, share)| share);
        (100.0 * share).round() as u8
    })
}

#[test]
fn a_stripe_covers_its_share_of_a_wide_patch() {
    assert!((stripe_share(0.0, 0.6, 0.15) - 0.25).abs() < 1e-12);
    assert!((stripe_share(0.02, 0.01, 0.15) - 1.0).abs() < 1e-12);
    assert!((stripe_share(0.075, 0.01, 0.15) - 0.5).abs() < 1e-9);
    assert!(stripe_share(0.5, 0.2, 0.15).abs() < 1e-12);
}

#[test]
fn marks_have_the_profile_of_their_style() {
    let across = [-0.2, -0.15, -0.1, 0.0, 0.07, 0.08, 0.2, 0.24];
    let solid = paint_across(&freshly_painted(MarkStyle::Solid), across);
    assert_eq!(solid, [0, 0, 0, 100, 100, 0, 0, 0]);
    let double = paint_across(&freshly_painted(MarkStyle::Double), across);
    assert_eq!(double, [100, 100, 100, 0, 0, 100, 100, 0]);
    let none = paint_across(&freshly_painted(MarkStyle::None), across);
    assert_eq!(none, [0; 8]);
}

#[test]
fn dashes_have_their_length_and_period() {
    let mut scene = freshly_painted(MarkStyle::Dashed);
    (scene.markings.dash_m, scene.markings.dash_period_m) = (4.0, 10.0);
    let paint = Paint::new(&scene, 3);
    let share = |s_m: f64, spread_m| {
        let patch = GroundPatch {
            spread_s_m: spread_m,
            ..patch(s_m, 1.75, 0.002)
        };
        paint.cover(&patch, 0.002).map_or(0.0, |(_, share)| share)
    };
    let painted_m: f64 = (0..10_000)
        .map(|i| 0.01 * f64::from(share(0.01 * f64::from(i), 0.01)))
        .sum();
    // Markers in the gaps would add a little.
    assert!((painted_m - 40.0).abs() < 2.0, "{painted_m}");
    for i in 0..100 {
        let s_m = 0.37 * f64::from(i);
        assert!((share(s_m, 0.01) - share(s_m + 10.0, 0.01)).abs() < 1e-4);
        // A patch as long as a period holds one dash wherever it lies.
        assert!((share(s_m, 10.0) - 0.4).abs() < 1e-6);
    }
}

#[test]
fn lanes_beyond_widen_the_road_and_end_at_an_edge_line() {
    let mut scene = freshly_painted(MarkStyle::Dashed);
    let narrow = Pavement::new(&scene);
    scene.markings.lanes_beyond = [2, 1];
    scene.markings.styles[0] = MarkStyle::Dashed;
    let wide = Pavement::new(&scene);
    assert!((wide.paint.road.edges_m[0] - narrow.paint.road.edges_m[0] - 7.0).abs() < 1e-9);
    assert!((wide.paint.road.edges_m[1] - narrow.paint.road.edges_m[1] + 3.5).abs() < 1e-9);
    let unbroken = |d_m: f64| {
        (0..200).all(|i| {
            let patch = patch(0.1 * f64::from(i), d_m, 0.002);
            wide.paint
                .cover(&patch, 0.002)
                .is_some_and(|(_, share)| share > 0.9)
        })
    };
    assert!(unbroken(5.25 + 7.0) && unbroken(-5.25 - 3.5));
    assert!(!unbroken(5.25) && !unbroken(5.25 + 3.5));
}

#[test]
fn worn_paint_covers_less() {
    let covered = |wear| {
        let mut scene = freshly_painted(MarkStyle::Solid);
        scene.look.paint_wear = wear;
        let paint = Paint::new(&scene, 1);
        let shares = (0..2_000).filter_map(|i| {
            let patch = patch(0.05 * f64::from(i), 1.75, 0.01);
            paint.cover(&patch, 0.01).map(|(_, share)| share)
        });
        shares.sum::<f32>() / 2_000.0
    };
    assert!((covered(0.0) - 1.0).abs() < 1e-6);
    assert!((0.55..0.9).contains(&covered(0.5)), "{}", covered(0.5));
    assert!(covered(1.0) < covered(0.5) - 0.1);
}

#[test]
fn a_wet_road_is_darker_and_shines_where_one_looks_along_it() {
    let wet_and_dry = [1.0, 0.0].map(|wetness| {
        let mut scene = empty_road();
        scene.look.wetness = wetness;
        Pavement::new(&scene)
    });
    let light = light(0.0);
    let patch = patch(100.0, 0.4, 0.05);
    let [wet, dry] = wet_and_dry
        .each_ref()
        .map(|road| road.albedo(&patch).norm());
    assert!(wet < 0.7 * dry);
    let seen = |view: Vector3<f32>| {
        wet_and_dry.each_ref().map(|road| {
            road.radiance(&patch, &light, &view.normalize(), 1.0, 1.0)
                .norm()
        })
    };
    let [wet_near, dry_near] = seen(Vector3::new(1.0, 0.0, -1.0));
    let [wet_far, dry_far] = seen(Vector3::new(1.0, 0.0, -0.03));
    assert!(wet_near < 0.8 * dry_near && wet_far > 1.5 * dry_far);
}

proptest! {
    #[test]
    fn every_ground_has_a_colour(
        (seed, direct, wear, albedo) in (any::<u64>(), 0.0..1.0, 0.0..1.0, 0.0..1.0),
        (wetness, damage, spread_m) in (0.0..1.0, 0.0..1.0, 0.0..60.0),
        (s_m, d_m) in (-1e4..1e4, -80.0..80.0),
        lanes_beyond in any::<[u8; 2]>().prop_map(|lanes| lanes.map(|n| n % 6)),
        down in 0.0..1.0_f32,
        yellow in any::<bool>(),
    ) {
        let mut scene = empty_road();
        let look = &mut scene.look;
        (look.texture_seed, look.direct_light, look.paint_wear) = (seed, direct, wear);
        (look.asphalt_albedo, look.wetness, look.damage) = (albedo, wetness, damage);
        scene.markings.lanes_beyond = lanes_beyond;
        if yellow {
            scene.markings.colors = [PaintColor::Yellow; 4];
        }
        let road = Pavement::new(&scene);
        let patch = patch(s_m, d_m, spread_m);
        let view = Vector3::new(1.0, 0.1, -down).normalize();
        let color = road.radiance(&patch, &Light::new(&scene.look), &view, 1.0, 1.0);
        prop_assert!(color.iter().all(|x| x.is_finite() && *x >= 0.0), "{}", color);
        let albedo = road.albedo(&patch);
        prop_assert!(albedo.iter().all(|x| (0.0..1.5).contains(x)), "{}", albedo);
    }
}
