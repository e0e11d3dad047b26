fn main() {
    for n in [30, 90, 1000] {
        println!("{:?}", covista_traffic::time_ring(n, 10_000_000));
    }
    for t in 1..=9 {
        let mut s = [0.0; 5];
        let mut h: f64 = 1e9;
        let mut ad: f64 = 0.0;
        for seed in 0..5 {
            let mut r = covista_traffic::Ring::new(covista_traffic::RingSettings {
                density: t as f64 / 10.0,
                seed,
                ..Default::default()
            })
            .unwrap();
            for _ in 0..40000 {
                r.step(&[]).unwrap();
                for v in r.vehicles() {
                    ad = ad.min(v.accel_mps2);
                }
            }
            let p = r.report();
            s[0] += p.mean_velocity_mps / 5.;
            s[1] += p.collisions as f64;
            s[2] += p.human_lane_changes as f64 / 5.;
            s[3] += p.flow_per_h_lane / 5.;
            h = h.min(p.min_headway_m.unwrap());
        }
        println!(
            "{t} v {:.2} coll {} lc {} flow {:.0} minhw {h:.2} hardest {ad:.2}",
            s[0], s[1], s[2], s[3]
        );
    }
}
