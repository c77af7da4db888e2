//! JSON for the page: numbers as long as anybody can read, and nothing said of what is not known.

use serde::Serialize;
use serde_json::Value;

/// Decimals that are kept: a tenth of a microsecond, of a millimetre's thousandth, of a sigma.
const DECIMALS: i32 = 7;

/// `value` as JSON, with rounded numbers and without `null` members of objects. `null` in a list keeps its place.
///
/// # Panics
/// Never, for types of this crate: their keys are strings.
pub(crate) fn compact_json(value: &impl Serialize) -> String {
    let mut tree = serde_json::to_value(value).expect("string keys only");
    shorten(&mut tree);
    tree.to_string()
}

fn shorten(value: &mut Value) {
    match value {
        Value::Object(members) => {
            members.retain(|_, member| !member.is_null());
            members.values_mut().for_each(shorten);
        }
        Value::Array(items) => items.iter_mut().for_each(shorten),
        Value::Number(number) if number.is_f64() => {
            let scale = 10_f64.powi(DECIMALS);
            let rounded = number.as_f64().map(|number| (number * scale).round() / scale);
            // A number too large to be scaled is left as it is.
            if let Some(short) = rounded.and_then(serde_json::Number::from_f64) {
                *number = short;
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::keyframe_at;

    #[test]
    fn numbers_are_short_and_what_is_not_known_is_not_said() {
        let value = serde_json::json!({"a": 0.123_456_789_012, "b": null, "c": [null, 1e9, 3], "d": {"e": null}});
        assert_eq!(compact_json(&value), r#"{"a":0.1234568,"c":[null,1000000000.0,3],"d":{}}"#);
    }

    #[test]
    fn a_keyframe_stays_what_it_is() {
        let json: Value = serde_json::from_str(&compact_json(&keyframe_at(5.0))).expect("valid JSON");
        assert_eq!((json["t"].as_f64(), json["factors"][2]["refused"].as_str()), (Some(5.0), Some("gated")));
        assert!(json["factors"][0].get("refused").is_none());
    }
}
