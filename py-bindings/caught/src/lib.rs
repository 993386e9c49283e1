//! `#[caught]`: the body of a function, or of every function of an `impl`, becomes the argument of
//! `crate::faults::caught`. It stands above PyO3's attributes, so that a panic is an exception of ours before PyO3
//! sees it.

use proc_macro::{Delimiter, Group, TokenStream, TokenTree};

/// See the crate.
///
/// Each function must return what `crate::faults::caught` returns.
#[proc_macro_attribute]
pub fn caught(_: TokenStream, item: TokenStream) -> TokenStream {
    let first = item.clone().into_iter().find_map(|token| match token {
        TokenTree::Ident(word) => Some(word.to_string()).filter(|w| w == "impl" || w == "fn"),
        _ => None,
    });
    match first.as_deref() {
        Some("impl") => wrap_functions_within(item),
        _ => wrap_functions(item),
    }
}

/// The first braces after each `fn` are its body.
fn wrap_functions(item: TokenStream) -> TokenStream {
    let mut in_function = false;
    let wrap = |token: TokenTree| match &token {
        TokenTree::Ident(word) if word.to_string() == "fn" => {
            in_function = true;
            token
        }
        TokenTree::Group(body) if in_function && body.delimiter() == Delimiter::Brace => {
            in_function = false;
            call(body)
        }
        _ => token,
    };
    item.into_iter().map(wrap).collect()
}

/// The braces of an `impl` hold functions.
fn wrap_functions_within(item: TokenStream) -> TokenStream {
    let wrap = |token| match token {
        TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
            same_place(Delimiter::Brace, wrap_functions(group.stream()), &group)
        }
        other => other,
    };
    item.into_iter().map(wrap).collect()
}

/// `{ crate::faults::caught(move || body) }`
fn call(body: &Group) -> TokenTree {
    let mut argument: TokenStream = "move ||".parse().expect("the head of a closure");
    argument.extend([TokenTree::Group(body.clone())]);
    let mut inner: TokenStream = "crate::faults::caught".parse().expect("a path");
    inner.extend([same_place(Delimiter::Parenthesis, argument, body)]);
    same_place(Delimiter::Brace, inner, body)
}

/// A group that errors find where the old one stood.
fn same_place(delimiter: Delimiter, inner: TokenStream, old: &Group) -> TokenTree {
    let mut group = Group::new(delimiter, inner);
    group.set_span(old.span());
    TokenTree::Group(group)
}
