use super::*;

fn points(of: &[(f64, f64)]) -> Vec<Expected> {
    of.iter().map(|(ms, flip)| Expected { ms: *ms, flip: *flip }).collect()
}

fn chosen(of: &[(f64, f64)], ms: Option<f64>, flip: Option<f64>) -> (usize, bool, bool) {
    let choice = choose(&points(of), Target { ms, flip }).expect("a choice");
    assert_eq!(choice.expected, points(of)[choice.index]);
    (choice.index, choice.reached.ms, choice.reached.flip)
}

//                               dear, best    middle       beaten by 1   fast, bad
const FOUR: [(f64, f64); 4] = [(400.0, 0.05), (100.0, 0.08), (200.0, 0.09), (20.0, 0.3)];

#[test]
fn of_those_that_are_accurate_enough_the_cheapest_is_chosen() {
    assert_eq!(chosen(&FOUR, None, Some(0.5)), (3, true, true));
    assert_eq!(chosen(&FOUR, None, Some(0.1)), (1, true, true));
    assert_eq!(chosen(&FOUR, None, Some(0.08)), (1, true, true), "the bound itself is within");
    assert_eq!(chosen(&FOUR, None, Some(0.07)), (0, true, true));
    assert_eq!(chosen(&FOUR, None, Some(0.01)), (0, true, false), "none: the most accurate");
}

#[test]
fn of_those_that_are_fast_enough_the_most_accurate_is_chosen() {
    assert_eq!(chosen(&FOUR, Some(1000.0), None), (0, true, true));
    assert_eq!(chosen(&FOUR, Some(250.0), None), (1, true, true));
    assert_eq!(chosen(&FOUR, Some(20.0), None), (3, true, true), "the bound itself is within");
    assert_eq!(chosen(&FOUR, Some(5.0), None), (3, false, true), "none: the fastest");
}

#[test]
fn with_both_the_time_wins_where_not_both_can_be_had() {
    assert_eq!(chosen(&FOUR, Some(500.0), Some(0.1)), (1, true, true), "no more accurate than asked");
    assert_eq!(chosen(&FOUR, Some(150.0), Some(0.06)), (1, true, false));
    assert_eq!(chosen(&FOUR, Some(500.0), Some(0.01)), (0, true, false));
    assert_eq!(chosen(&FOUR, Some(5.0), Some(0.06)), (3, false, false));
}

#[test]
fn ties_go_to_the_cheaper_and_then_to_the_more_accurate() {
    let even = [(50.0, 0.1000), (40.0, 0.1019), (45.0, 0.1010), (30.0, 0.1021)];
    assert_eq!(chosen(&even, Some(100.0), None), (1, true, true), "0.0019 cannot be told apart, 0.0021 can");
    assert_eq!(chosen(&even, None, Some(0.01)), (1, true, false));
    let same = [(10.0, 0.3), (10.0, 0.2), (10.0, 0.25)];
    assert_eq!(chosen(&same, None, Some(0.4)), (1, true, true));
    assert_eq!(chosen(&same, Some(1.0), None), (1, false, true));
}

#[test]
fn what_is_not_finite_is_never_chosen() {
    let holes = [(f64::NAN, 0.01), (1.0, f64::NAN), (f64::INFINITY, 0.0), (30.0, 0.2)];
    assert_eq!(chosen(&holes, None, Some(0.5)), (3, true, true));
    assert_eq!(chosen(&holes, Some(100.0), None), (3, true, true));
    assert_eq!(choose(&points(&holes[..3]), Target { ms: Some(100.0), flip: None }), None);
    assert_eq!(choose(&[], Target { ms: None, flip: Some(0.1) }), None);
}

fn times(of: &[(&str, f64)]) -> BTreeMap<String, f64> {
    of.iter().map(|(name, ms)| ((*name).to_owned(), *ms)).collect()
}

fn sheet() -> Sheet {
    let passes = times(&[("gbuffer", 20.0), ("relight", 80.0), ("atrous", 30.0)]);
    let candidate = Candidate { method: "iprt".into(), passes, rest_ms: 1.0, prepare_ms: 100.0, ..Default::default() };
    let paper = Candidate { method: "paper".into(), passes: times(&[("gbuffer", 20.0)]), ..candidate.clone() };
    Sheet {
        size: [160, 90],
        truth: "model truth".into(),
        noise: 0.01,
        fixed: times(&[("atrous", 0.5)]),
        complete: true,
        candidates: vec![candidate, paper],
    }
}

#[test]
fn times_grow_with_the_picture_but_for_what_is_fixed() {
    let sheet = sheet();
    let predict = |size, video| sheet.predict(&sheet.candidates[0], size, video);
    assert_eq!(predict([160, 90], false), 131.0);
    // At four times the pixels the sum is 80 for gbuffer, 80 for relight, 15 fixed and 60 growing for atrous,
    // and the rest.
    assert_eq!(predict([320, 180], false), 236.0);
    assert_eq!(predict([80, 45], true), 5.0 + 80.0 + 15.0 + 3.75 + 1.0 + 100.0);
}

#[test]
fn a_method_that_is_asked_for_is_the_only_one() {
    let sheet = sheet();
    let of = |method| choose(&sheet.expected(method, [160, 90], false), Target { ms: Some(1000.0), flip: None });
    assert_eq!(of(None).expect("the cheaper").index, 1);
    assert_eq!(of(Some("iprt")).expect("it").index, 0);
    assert_eq!(of(Some("ibl")), None);
}

#[test]
fn a_line_through_two_sizes_gives_the_fixed_share() {
    let small = times(&[("gbuffer", 12.0), ("relight", 80.0), ("atrous", 10.0), ("temporal", 4.0)]);
    let large = times(&[("gbuffer", 42.0), ("relight", 80.0), ("atrous", 44.0)]);
    let fixed = fixed_shares((&small, [160, 90]), (&large, [320, 180]));
    // The times are 2 + 10·growth, constant, more than 10·growth, and not measured.
    assert!((fixed["gbuffer"] - 1.0 / 6.0).abs() < 1e-12);
    assert_eq!((fixed["relight"], fixed["atrous"], fixed.len()), (1.0, 0.0, 3));
    let sheet = Sheet { fixed, ..sheet() };
    let candidate = Candidate { passes: small, ..Default::default() };
    // The prediction meets what was measured at both sizes.
    assert!((sheet.predict(&candidate, [320, 180], false) - (42.0 + 80.0 + 40.0 + 16.0)).abs() < 1e-9);
}

#[test]
fn a_sheet_serves_pictures_of_its_shape() {
    let sheet = sheet();
    assert!(sheet.serves([160, 90]) && sheet.serves([1280, 720]) && sheet.serves([96, 54]));
    assert!(!sheet.serves([512, 384]), "another shape is another view");
    assert!(!Sheet { size: [32, 18], ..sheet.clone() }.serves([320, 180]), "too small to say much");
    assert!(!Sheet { complete: false, ..sheet }.serves([160, 90]));
}
