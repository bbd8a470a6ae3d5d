//! The use cases of the manuals, written once for host device and image (SPEC 8).

use firmware_in_the_loop::bench::ImageBench;
use firmware_in_the_loop::board::{Board, NUCLEO_F429ZI, NUCLEO_F446RE};
use hal_sim::use_case::{find, play};

fn passes(board: &'static Board, name: &str) {
    let case = find(name).unwrap_or_else(|| panic!("there is no use case {name}"));
    let mut lines = Vec::new();
    let result = play(case, &mut ImageBench::new(board, case), &mut |line| lines.push(line.to_owned()));
    result.unwrap_or_else(|deviation| panic!("{}\n{deviation}", lines.join("\n")));
}

macro_rules! use_cases {
    ($($test:ident: $name:literal,)*) => {
        $(#[test]
        fn $test() {
            passes(&NUCLEO_F429ZI, $name);
        })*

        mod f446re {
            use super::*;

            $(#[test]
            fn $test() {
                passes(&NUCLEO_F446RE, $name);
            })*
        }

        #[test]
        fn none_is_left_out() {
            let names: Vec<_> = hal_sim::use_case::all().into_iter().map(|case| case.name).collect();
            assert_eq!(names, [$($name),*]);
        }
    };
}

use_cases! {
    use_case_1: "1",
    use_case_2: "2",
    use_case_3: "3",
    use_case_4: "4",
    use_case_5: "5",
    use_case_6: "6",
    use_case_isobus: "isobus",
    use_case_hat: "hat",
}
