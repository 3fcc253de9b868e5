//! The stability suite can fail: each case notices the faults that it names, and theory's two predictions come true.

use crate::common::validated;
use iprt::{
    settings::Method,
    stability::{Broken, Case, Outcome, Suite, cases},
};

fn case(name: &str) -> Case {
    cases::all().into_iter().find(|case| case.name == name).expect("there is such a case")
}

/// Runs the cases that `chosen` picks, whole and broken.
fn faults_are_noticed(part: usize) {
    validated(|gpu| {
        let suite = Suite::new(gpu, true);
        let mut unnoticed = Vec::new();
        for case in cases::all().into_iter().skip(part).step_by(PARTS) {
            let run = |broken| suite.run(&case, Method::Iprt, broken).expect("runs");
            let whole = run(None);
            assert!(whole.value.is_finite() && whole.value >= 0.0, "{}: {}", case.name, whole.value);
            pictures_fit(&case, &whole);
            // limits are those of the full size: so small, not all that passes there does
            assert!(!PASS.contains(&case.name) || whole.value <= case.limit, "{}: {}", case.name, whole.value);
            assert!(!case.catches.is_empty(), "{}: a case that nothing can fail is none", case.name);
            for broken in case.catches {
                let value = run(Some(*broken)).value;
                println!(
                    "{:<22} {:>10.5} whole, {value:>10.5} with {broken:?}, limit {}",
                    case.name, whole.value, case.limit
                );
                // beyond the limit, and, where it is today, clearly worse
                if !(value > case.limit && value > 1.3 * whole.value) {
                    unnoticed.push(format!(
                        "{}: {value} with {broken:?}, {} whole, limit {}",
                        case.name, whole.value, case.limit
                    ));
                }
            }
        }
        assert!(unnoticed.is_empty(), "{unnoticed:#?}");
    });
}

fn pictures_fit(case: &Case, outcome: &Outcome) {
    let pixels = (outcome.size[0] * outcome.size[1]) as usize;
    assert!(outcome.worst.len() == pixels && outcome.truth.len() == pixels, "{}", case.name);
}

const PARTS: usize = 2;

/// What passes in small pictures and few frames, too, and by far.
const PASS: [&str; 9] = [
    "rotation",
    "caster_from_behind",
    "camera_inside",
    "behind_every_surface",
    "dark_corner",
    "moving_camera",
    "empty_scene",
    "odd_sizes",
    "determinism",
];

#[test]
fn every_fault_is_noticed_in_one_half() {
    faults_are_noticed(0);
}

#[test]
fn every_fault_is_noticed_in_the_other_half() {
    faults_are_noticed(1);
}

#[test]
fn theory_comes_true() {
    validated(|gpu| {
        let suite = Suite::new(gpu, true);
        for case in cases::all().into_iter().filter(|case| !case.must_fail.is_empty()) {
            let good = suite.run(&case, Method::Iprt, None).expect("runs").value;
            for fails in case.must_fail {
                let bad = suite.run(&case, *fails, None).expect("runs").value;
                println!("{}: {fails:?} {bad}, iprt {good}, limit {}", case.name, case.limit);
                assert!(bad > case.limit && bad > 1.5 * good, "{}: {fails:?} {bad}, iprt {good}", case.name);
            }
        }
        for (name, fails) in [("spatial_variation", Method::Ibl), ("off_screen_caster", Method::Paper)] {
            assert!(case(name).must_fail.contains(&fails));
        }
    });
}

/// The yardstick itself: what the model converges to is what the worlds say.
#[test]
fn the_truth_is_what_the_model_converges_to() {
    validated(|gpu| {
        let suite = Suite::new(gpu, true);
        for (name, limit) in [("spatial_variation", 0.03), ("silhouettes", 0.04)] {
            let value = suite.run(&case(name), Method::Reference, None).expect("runs").value;
            println!("{name}: {value}");
            assert!(value < limit, "{name}: {value}");
        }
    });
}

#[test]
fn names_are_words_of_their_own() {
    let all = cases::all();
    for (i, case) in all.iter().enumerate() {
        assert!(case.name.chars().all(|c| c.is_ascii_lowercase() || c == '_'), "{}", case.name);
        assert!(all[..i].iter().all(|other| other.name != case.name), "{} is there twice", case.name);
        assert!(case.limit.is_finite() && case.asks.ends_with('?') && !case.reason.is_empty(), "{}", case.name);
        for broken in case.catches {
            if let Broken::Setting(name, value) = broken {
                iprt::settings::Settings::of(Method::Iprt).set(name, value, case.name).expect("a good setting");
            }
        }
    }
}
