use super::*;

const HEIGHT: u32 = 200;

/// Busy times of a picture whose rows cost `row_cost`, on devices of equal speed.
fn costs_of(assignment: &Assignment, devices: usize, row_cost: impl Fn(u32) -> f64) -> Vec<StageCost> {
    let stripes = assignment.stripes(Stage::PathTrace, Eye::Left);
    (0..devices)
        .map(|device| {
            let rows = stripes.rows(device);
            let busy_ms = rows.clone().map(&row_cost).sum();
            StageCost { stage: Stage::PathTrace, view: Eye::Left, device, rows, busy_ms }
        })
        .collect()
}

fn all_policies(devices: usize) -> Vec<Box<dyn Policy>> {
    let rules = [RatioRule { stage: None, view: None, ratios: (1..=devices).map(|i| i as f64).collect() }];
    vec![
        Box::new(Even::new(HEIGHT, devices)),
        Box::new(Static::new(HEIGHT, devices, &rules).unwrap()),
        Box::new(Measured::new(HEIGHT, devices)),
    ]
}

#[test]
fn every_policy_covers_every_row_of_every_stage_once() {
    for devices in 1..=8 {
        for mut policy in all_policies(devices) {
            for _ in 0..4 {
                let a = policy.assign();
                for stage in Stage::RATIO_GROUPS {
                    for view in Eye::ALL {
                        let s = a.stripes(stage, view);
                        assert_eq!((s.devices(), s.height()), (devices, HEIGHT), "{}", policy.name());
                    }
                }
                policy.learn(&costs_of(&a, devices, |row| f64::from(row / 50) + 0.01));
            }
        }
    }
}

#[test]
fn measured_stripes_even_out_a_sky_above_a_city() {
    let mut policy = Measured::new(HEIGHT, 2);
    let row_cost = |row| if row < 120 { 0.1 } else { 1.0 };
    let mut imbalance = f64::INFINITY;
    for _ in 0..8 {
        let costs = costs_of(&policy.assign(), 2, row_cost);
        let total: f64 = costs.iter().map(|c| c.busy_ms).sum();
        imbalance = costs.iter().map(|c| c.busy_ms).fold(0.0, f64::max) * 2.0 / total;
        policy.learn(&costs);
    }
    assert!(imbalance < 1.05, "{imbalance}");
}

#[test]
fn ratio_rules_narrow_to_stage_and_view() {
    let rule: RatioRule = "path_trace.left=5,1,2".parse().unwrap();
    assert_eq!((rule.stage, rule.view), (Some(Stage::PathTrace), Some(Eye::Left)));
    let a = Static::new(80, 3, &[rule]).unwrap().assign();
    assert_eq!(a.stripes(Stage::PathTrace, Eye::Left).inner_edges(), &[50, 60]);
    assert_eq!(a.stripes(Stage::PathTrace, Eye::Right).inner_edges(), &[26, 53]);
    assert!("shade=1,2".parse::<RatioRule>().is_err());
    assert!("1,x".parse::<RatioRule>().is_err());
    assert!(Static::new(80, 2, &["1,2,3".parse().unwrap()]).is_err());
}

#[test]
fn devices_that_are_left_cover_every_row() {
    for mut policy in all_policies(4) {
        for (left, gone) in [(3, 0), (2, 2), (1, 0)] {
            let before = policy.assign();
            policy.learn(&costs_of(&before, left + 1, |row| f64::from(row) + 1.0));
            policy.remove_device(gone);
            let stripes = policy.assign().stripes(Stage::PathTrace, Eye::Left).clone();
            assert_eq!((stripes.devices(), stripes.height()), (left, HEIGHT), "{}", policy.name());
        }
    }
}

#[test]
fn ratios_of_those_left_stay() {
    let mut policy = Static::new(80, 3, &["5,1,2".parse().unwrap(), "atrous=0,1,0".parse().unwrap()]).unwrap();
    policy.remove_device(1);
    let assignment = policy.assign();
    assert_eq!(assignment.stripes(Stage::PathTrace, Eye::Left).inner_edges(), &[57]);
    assert_eq!(assignment.stripes(Stage::Atrous, Eye::Left).inner_edges(), &[40]);
}
