//! The header declares exactly the functions that there are, with the types that they have.

use std::collections::BTreeMap;
use std::fs;

const HERE: &str = env!("CARGO_MANIFEST_DIR");

/// C's word for a type of ours.
fn in_c(rust: &str) -> String {
    if let Some(to) = rust.strip_prefix("*const ") {
        return format!("const {} *", in_c(to));
    }
    if let Some(to) = rust.strip_prefix("*mut ") {
        return format!("{} *", in_c(to));
    }
    let word = match rust {
        "u8" => "uint8_t",
        "u32" => "uint32_t",
        "usize" => "size_t",
        "f32" => "float",
        "f64" => "double",
        "c_char" => "char",
        "Status" => "rodgym_status",
        "Handle" => "rodgym_controller",
        "Quantity" => "rodgym_quantity",
        "()" => "void",
        other => panic!("no word of C for {other}"),
    };
    word.into()
}

/// A declaration without the spaces that mean nothing.
fn plain(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    text.replace(" *", "*").replace("* ", "*").replace("( ", "(").replace(" )", ")")
}

/// Functions that C may call, by name, as C would declare them.
fn functions() -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    for file in fs::read_dir(format!("{HERE}/src")).unwrap() {
        let source = fs::read_to_string(file.unwrap().path()).unwrap();
        for part in source.split("extern \"C\" fn ").skip(1) {
            let (name, rest) = part.split_once('(').unwrap();
            let (arguments, rest) = rest.split_once(')').unwrap();
            let result = rest.split_once('{').unwrap().0.trim().trim_start_matches("->").trim();
            let arguments: Vec<String> = arguments
                .split(',')
                .filter_map(|argument| argument.split_once(':'))
                .map(|(name, kind)| format!("{} {}", in_c(kind.trim()), name.trim()))
                .collect();
            let arguments =
                if arguments.is_empty() { "void".to_owned() } else { arguments.join(", ") };
            let result = in_c(if result.is_empty() { "()" } else { result });
            found.insert(name.to_owned(), plain(&format!("{result} {name}({arguments});")));
        }
    }
    found
}

#[test]
fn the_header_declares_what_there_is() {
    let header = fs::read_to_string(format!("{HERE}/include/rodgym_controllers.h")).unwrap();
    let mut code = String::new();
    for (i, part) in header.split("/*").enumerate() {
        code.push_str(if i == 0 { part } else { part.split_once("*/").unwrap().1 });
    }
    let declared: BTreeMap<String, String> = code
        .split(';')
        .filter(|part| part.contains("rodgym_") && part.contains('(') && !part.contains('{'))
        .map(|part| {
            // (Lines of the preprocessor may stand before the first.)
            let lines: Vec<&str> = part.lines().filter(|line| !line.starts_with('#')).collect();
            let declaration = plain(&format!("{};", lines.join(" ")));
            let name = declaration.split_once('(').unwrap().0;
            let name = name.rsplit([' ', '*']).next().unwrap().to_owned();
            (name, declaration)
        })
        .collect();
    let there = functions();
    assert!(there.len() > 10 && there.contains_key("rodgym_step"), "functions are found");
    assert_eq!(declared, there);
}

#[test]
fn the_header_has_the_codes_and_the_version_of_the_library() {
    use rodgym_controllers::Status;
    let header = fs::read_to_string(format!("{HERE}/include/rodgym_controllers.h")).unwrap();
    let codes = [
        ("OK", Status::Ok),
        ("POINTER", Status::Pointer),
        ("SIZE", Status::Size),
        ("PARAMETER", Status::Parameter),
        ("FILE", Status::File),
        ("DESIGN", Status::Design),
        ("OBSERVATION", Status::Observation),
        ("FAULT", Status::Fault),
    ];
    for (name, code) in codes {
        let line = format!("    RODGYM_{name} = {}", code as i32);
        assert!(header.contains(&line), "{line}");
    }
    assert_eq!(header.matches("    RODGYM_").count(), codes.len(), "codes of the header");
}
