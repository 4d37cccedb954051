//! Devices of several ranks give the bytes of one device. Here the ranks are threads with channels between them;
//! everything above their links is the code that MPI's processes run.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, LazyLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::common::{Stage, Subject, devices_to_lose, foveate, is_thorough, project};
use crate::moving::{times_s, watched};
use crate::reference::scenes::moving;
use crate::same_bytes::{HEIGHT, Rows, WIDTH, assert_same_frames};
use diptych::RunConfig;
use diptych::device::GpuDevice;
use diptych::exec::ranks::{Devices, Host, Link, Load, Loading, Node, Request, Way, serve};
use diptych::frame::Foveation;
use diptych::projection::{LogPolar, PolarSpace};
use diptych::quality::{Denoiser, Filter};
use diptych::scene::shot::Gaze;
use diptych::schedule::{Even, Measured};
use diptych::tables::SceneTables;

/// Instant before all ranks start.
static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);

/// A rank for tests, with subjects by name.
struct Here {
    subjects: Vec<(String, Arc<SceneTables>)>,
    /// Origin of its times; none unless it records.
    zero: Option<Instant>,
}

impl Host for Here {
    fn open(&mut self, count: usize) -> Result<Vec<GpuDevice>, String> {
        Ok(devices_to_lose(count))
    }

    fn load(&mut self, what: &Load) -> Result<Arc<SceneTables>, String> {
        let found = self.subjects.iter().find(|(name, _)| *name == what.shot);
        found.map(|(_, tables)| Arc::clone(tables)).ok_or_else(|| format!("there is no {}", what.shot))
    }

    fn record(&mut self, zero: Instant) -> Result<(), String> {
        self.zero = Some(zero);
        Ok(())
    }

    /// Returns the origin of its clock, nanoseconds after [`BEGIN`].
    fn recorded(&mut self) -> Vec<u8> {
        self.zero.map_or_else(Vec::new, |zero| zero.duration_since(*BEGIN).as_nanos().to_le_bytes().to_vec())
    }

    fn interrupted(&self) -> Option<i32> {
        None
    }
}

/// A packet, with the rank that sent it.
type Sent = (usize, Vec<u8>);

/// A link with latency between threads.
struct Slow {
    rank: usize,
    inbox: Receiver<Sent>,
    outboxes: Vec<Sender<Sent>>,
    by: Duration,
    held: VecDeque<(Instant, Sent)>,
}

impl Link for Slow {
    fn rank(&self) -> usize {
        self.rank
    }

    fn ranks(&self) -> usize {
        self.outboxes.len()
    }

    fn host(&self) -> String {
        format!("thread {}", self.rank)
    }

    fn send(&mut self, to: usize, packet: Vec<u8>, _: Way) {
        // Ignore the error: a rank that has left needs no packets.
        let _ = self.outboxes[to].send((self.rank, packet));
    }

    fn receive(&mut self) -> Option<Sent> {
        let due = Instant::now() + self.by;
        self.held.extend(self.inbox.try_iter().map(|packet| (due, packet)));
        let is_due = self.held.front().is_some_and(|(due, _)| *due <= Instant::now());
        is_due.then(|| self.held.pop_front()).flatten().map(|(_, packet)| packet)
    }

    fn is_settled(&mut self) -> bool {
        true
    }

    fn leave(&mut self) {}

    fn abort(&mut self, _: u8) {}
}

/// Rank 0, connected to the others.
struct Ranks {
    node: Arc<Node>,
    others: Vec<JoinHandle<(u8, u64)>>,
}

impl Ranks {
    fn new(count: usize, subjects: &[&Subject]) -> Self {
        Self::apart(Duration::ZERO, count, subjects)
    }

    /// Creates ranks whose packets take this long.
    fn apart(by: Duration, count: usize, subjects: &[&Subject]) -> Self {
        LazyLock::force(&BEGIN);
        let (outboxes, inboxes): (Vec<_>, Vec<_>) = (0..count).map(|_| channel()).unzip();
        let link = |(rank, inbox)| Slow { rank, inbox, outboxes: outboxes.clone(), by, held: VecDeque::new() };
        let mut links = inboxes.into_iter().enumerate().map(link);
        let first = links.next().unwrap();
        let node = Node::join(move || Ok(first), |_| ()).unwrap();
        let subjects: Vec<_> = subjects.iter().map(|s| (s.name.clone(), Arc::clone(&s.tables))).collect();
        let other = |link: Slow| {
            let mut host = Here { subjects: subjects.clone(), zero: None };
            std::thread::spawn(move || {
                let node = Node::join(move || Ok(link), |_| ()).unwrap();
                let status = serve(&node, &mut host).unwrap();
                node.end(status);
                (status, node.row_bytes())
            })
        };
        let others = links.map(other).collect();
        node.meet().unwrap();
        Self { node, others }
    }

    fn load(&self, subject: &Subject) -> Result<(), String> {
        let what = Load { shot: subject.name.clone(), time_s: 0.0, files: None };
        Loading::begin(&self.node, what).check(&subject.tables).map_err(|e| e.to_string())
    }

    /// Opens this many devices on each rank.
    fn devices(&self, each: usize) -> Devices {
        let opening = Devices::open(&self.node, each);
        opening.with(devices_to_lose(each)).unwrap()
    }

    /// Returns the bytes of rows sent by all ranks.
    fn end(self) -> u64 {
        self.node.end(7);
        let others = self.others.into_iter().map(|rank| rank.join().unwrap());
        others
            .map(|(status, bytes)| {
                assert_eq!(status, 7);
                bytes
            })
            .sum::<u64>()
            + self.node.row_bytes()
    }
}

/// Returns subjects with settings and numbers of frames in flight.
fn cases<'a>(checker: &'a Subject, moving: &'a Subject) -> Vec<(&'static str, &'a Subject, RunConfig, usize)> {
    let polar = |space| {
        let gaze = [0.4, 0.3].map(|x| Gaze { path: vec![[0.0, x, 0.4], [0.2, x + 0.1, 0.5]] });
        let mut settings = checker.accumulated(WIDTH, HEIGHT);
        project(&mut settings, gaze, space);
        settings
    };
    let mut layers = checker.accumulated(WIDTH, HEIGHT);
    foveate(&mut layers, Default::default(), Foveation::default(), [2, 3, 5]);
    let mut bmfr = checker.accumulated(WIDTH, HEIGHT);
    bmfr.envelope.most.filter = Some(Filter::new(Denoiser::BMFR, 1));
    let mut all = vec![
        ("a scene that moves", moving, moving.accumulated(WIDTH, HEIGHT), 2),
        ("a radiance cache", checker, RunConfig { cache: true, ..checker.accumulated(WIDTH, HEIGHT) }, 2),
        ("a log-polar image", checker, polar(PolarSpace::Log(LogPolar::COMPOSITE)), 1),
    ];
    if is_thorough() {
        all.push(("a visual-polar image", checker, polar(PolarSpace::Visual), 1));
        all.push(("layers", checker, layers, 3));
        all.push(("bmfr", checker, bmfr, 2));
    }
    all
}

#[test]
fn same_bytes_on_ranks_with_the_traffic_of_the_graph() {
    let (checker, moving) = (Subject::load("builtin:checker"), watched(moving::everything()));
    let arrangements = if is_thorough() { &[(2, 1), (4, 1), (2, 2)][..] } else { &[(2, 1)] };
    for &(ranks, each) in arrangements {
        let joined = Ranks::new(ranks, &[&checker, &moving]);
        let mut devices = joined.devices(each);
        assert_eq!(devices.len(), ranks * each);
        let mut expected_bytes = 0;
        for (what, subject, mut settings, in_flight) in cases(&checker, &moving) {
            joined.load(subject).unwrap();
            settings.execution.frames_in_flight = in_flight;
            let one = Stage::even(subject, &settings, 1).frames_in_flight(&times_s()[..4]);
            let policy = Rows::Measured.policy(settings.grid().height, ranks * each);
            let mut stage = Stage::on(devices, subject, &settings, policy);
            let found = stage.frames_in_flight(&times_s()[..4]);
            devices = stage.into_all_devices();
            assert_same_frames(&format!("{what} on {ranks} x {each}"), &one, &found);
            expected_bytes += found.iter().filter_map(|f| f.report.bytes_between_ranks()).sum::<u64>();
        }
        drop(devices);
        assert!(expected_bytes > 0);
        assert_eq!(joined.end(), expected_bytes);
    }
}

/// Stripes are ragged and move. In the third frame the second rank loses one of its devices.
#[test]
fn same_bytes_when_another_rank_loses_a_device() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let one = Stage::even(&subject, &settings, 1).frames_in_flight(&times_s()[..4]);
    let joined = Ranks::new(2, &[&subject]);
    joined.load(&subject).unwrap();
    let mut stage = Stage::on(joined.devices(2), &subject, &settings, Box::new(Measured::new(HEIGHT, 4)));
    stage.inject(&["loss:dev3@frame2"], &[]);
    let found = stage.frames_in_flight(&times_s()[..4]);
    let faults: Vec<_> = stage.renderer().faults().iter().map(|fault| (fault.device, fault.frame)).collect();
    assert_eq!(faults, [(3, 2)]);
    assert_same_frames("with a device less", &one, &found);
    let left = stage.into_all_devices();
    assert_eq!(left.len(), 3);

    let ragged = Rows::Turns(&["1,1,1", "5,1,2", "0,1,1", "1,2,9"]).policy(HEIGHT, 3);
    let mut stage = Stage::on(left, &subject, &settings, ragged);
    assert_same_frames("on ragged stripes", &one, &stage.frames_in_flight(&times_s()[..4]));
    drop(stage);
    joined.end();
}

#[test]
fn rejects_ranks_with_another_scene() {
    let (checker, cornell) = (Subject::load("builtin:checker"), Subject::load("builtin:cornell"));
    let joined = Ranks::new(2, &[&Subject { name: checker.name.clone(), ..cornell }]);
    let refused = joined.load(&checker).unwrap_err();
    assert!(refused.starts_with("rank 1 on thread 1: its scene"), "{refused}");
    let refused = joined.load(&Subject { name: "nowhere".to_owned(), ..checker }).unwrap_err();
    assert_eq!(refused, "rank 1 on thread 1: there is no nowhere");
    joined.end();
}

/// All ranks use the same clock here, so the true origins are known.
#[test]
fn rank_clock_errors_stay_within_their_residuals() {
    let joined = Ranks::new(3, &[]);
    joined.node.ask(&Request::Record).wait().unwrap();
    let mut residuals_us = Vec::new();
    for _ in 0..30 {
        std::thread::sleep(Duration::from_millis(100));
        joined.node.ask(&Request::Recorded).wait().unwrap();
        for told in joined.node.recorded() {
            let nanos = u128::from_le_bytes(told.text.try_into().unwrap());
            let here_ms = joined.node.epoch().duration_since(*BEGIN).as_secs_f64() * 1e3;
            let wrong_us = (told.zero_ms + here_ms - nanos as f64 * 1e-6).abs() * 1e3;
            let Some(residual_us) = told.residual_us else { continue };
            println!("rank {}: {wrong_us:.1} µs wrong, said to be {residual_us:.1} at most", told.rank);
            assert!(wrong_us <= residual_us + 1.0, "rank {}: {wrong_us} µs, not {residual_us}", told.rank);
            residuals_us.push(residual_us);
        }
    }
    assert!(residuals_us.len() >= 20, "{residuals_us:?}");
    let least_us = residuals_us.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(least_us < 2_000.0, "{residuals_us:?}");
    joined.end();
}

/// The cost model measures a slow link, and frames over it take the predicted time.
#[test]
#[ignore = "needs a machine that does nothing else"]
fn frames_over_slow_links_take_as_long_as_predicted() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let joined = Ranks::apart(Duration::from_millis(40), 2, &[&subject]);
    joined.load(&subject).unwrap();
    let mut stage = Stage::on(joined.devices(1), &subject, &settings, Box::new(Even::new(HEIGHT, 2)));
    // Other load on the machine may disturb frames and predictions, but not in every round.
    let mut index = 0;
    let mut median = || {
        let mut ratios: Vec<f64> = Vec::new();
        for _ in 0..12 {
            let report = stage.frame(index).report;
            index += 1;
            assert!(report.makespan_ms > 40.0, "{}", report.makespan_ms);
            ratios.extend(report.predicted_ms.filter(|_| index > 3).map(|ms| ms / report.makespan_ms));
        }
        ratios.sort_by(f64::total_cmp);
        ratios[ratios.len() / 2]
    };
    let medians: Vec<f64> = (0..5).map(|_| median()).collect();
    assert!(medians.iter().any(|median| (0.9..1.1).contains(median)), "{medians:?}");
    drop(stage);
    joined.end();
}
