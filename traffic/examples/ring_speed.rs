fn main() { for n in [30, 90, 1000] { println!("{:?}", covista_traffic::time_ring(n, 10_000_000)); } }
