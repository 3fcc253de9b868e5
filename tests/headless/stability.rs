//! The stability suite measures what it says: theory's two predictions come true, and the truth is what the model converges to.

use crate::common::validated;
use iprt::{
    settings::Method,
    stability::{Case, Suite, cases},
};

fn case(name: &str) -> Case {
    cases::all().into_iter().find(|case| case.name == name).expect("there is such a case")
}

#[test]
fn theory_comes_true() {
    validated(|gpu| {
        let suite = Suite::new(gpu, true);
        for case in cases::all().into_iter().filter(|case| !case.must_fail.is_empty()) {
            let good = suite.run(&case, Method::Iprt).expect("runs").value;
            for fails in case.must_fail {
                let bad = suite.run(&case, *fails).expect("runs").value;
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
            let value = suite.run(&case(name), Method::Reference).expect("runs").value;
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
    }
}
