use covista_sensors::*;
use covista_world::*;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let (seed, from, to): (u64, u64, u64) = (args[1].parse().unwrap(), args[2].parse().unwrap(), args[3].parse().unwrap());
    let draw = args.len() > 4;
    let calibration = Calibration::kitti();
    for index in from..to {
        let sample = covista_traffic::sample_scene(seed, index);
        let t = std::time::Instant::now();
        let rays = RayScene::new(&sample.scene);
        let t_scene = t.elapsed();
        let view = Viewpoint::new(&sample.scene, &rays, sample.ego, &calibration).unwrap();
        let t = std::time::Instant::now();
        let mut image = take_picture(&view, index);
        let t_image = t.elapsed();
        let t = std::time::Instant::now();
        let truth = true_marks(&view);
        eprintln!("{index} n={} scene {t_scene:?} image {t_image:?} marks {:?} {:?}", sample.scene.vehicles.len(), t.elapsed(), sample.scene.look);
        if draw {
            for (m, rows) in truth.pixels.iter().enumerate() {
                for (a, u) in ROW_ANCHORS.iter().zip(rows) {
                    let Some(u) = u else { continue };
                    for du in -3..=3i32 {
                        for dv in -1..=0i32 {
                        if du.abs() < 1 { continue }
                        let (x, y) = (u.round() as i32 + du, a.0 as i32 + dv);
                        if x < 0 || x >= 1242 { continue }
                        let i = 3 * (y as usize * 1242 + x as usize);
                        let c = [[255,0,0],[0,255,0],[0,0,255],[255,0,255]][m];
                        image.rgb[i..i+3].copy_from_slice(&c);
                        }
                    }
                }
            }
        }
        image::save_buffer(format!("/tmp/cam/{seed}_{index}.png"), &image.rgb, image.width_px, image.height_px, image::ColorType::Rgb8).unwrap();
    }
}
