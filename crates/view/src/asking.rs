//! Requests of a viewer of the page to the program: find objects by words, give them labels, merge them, segment more
//! finely.

use serde_json::{Value, json};
use splatseg_geometry::SegmentId;
use std::sync::Arc;
use tungstenite::Message;

/// Maximum length of a text, bytes.
const MAX_TEXT: usize = 300;
/// Maximum number of objects to merge at once.
const MAX_MERGED: usize = 1000;

/// A viewer's request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ViewRequest {
    /// Find the objects that fit a text.
    Find(String),
    /// Give an object a label, or take its label away.
    Name(SegmentId, Option<String>),
    /// Make these objects one.
    Merge(Vec<SegmentId>),
    /// Segment later frames with the degree of detail of this name.
    Detail(String),
}

/// The answer to a [`ViewRequest`].
#[derive(Clone, Debug, PartialEq)]
pub enum ViewAnswer {
    /// The objects that fit a text, best first, each with its score, 0 to 1.
    Found(Vec<(SegmentId, f32)>),
    /// The request is done.
    Done,
}

/// Answers viewers, on their threads; an error is a sentence. See
/// [`ViewServer::answer_with`](crate::ViewServer::answer_with).
pub type AnswerViewer = Arc<dyn Fn(ViewRequest) -> Result<ViewAnswer, String> + Send + Sync>;

impl ViewRequest {
    /// The request in a text of the page: `{"ask": "find", "text": "red mug"}` or `{"ask": "name", "id": 15, "label":
    /// "mug"}` or `{"ask": "merge", "ids": [15, 7]}` or `{"ask": "detail", "detail": "fine"}`. `None` if it is none.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let value: Value = serde_json::from_str(text).ok()?;
        let short = |key: &str| Some(value.get(key)?.as_str()?.trim().to_owned()).filter(|text| text.len() <= MAX_TEXT);
        let id = |value: &Value| SegmentId::try_from(value.as_u64()?).ok().filter(|id| *id > 0);
        match value.get("ask")?.as_str()? {
            "find" => Some(Self::Find(short("text")?)),
            "name" => Some(Self::Name(id(value.get("id")?)?, Some(short("label")?).filter(|label| !label.is_empty()))),
            "merge" => {
                let ids = value.get("ids")?.as_array().filter(|ids| (2..=MAX_MERGED).contains(&ids.len()))?;
                Some(Self::Merge(ids.iter().map(id).collect::<Option<_>>()?))
            }
            "detail" => Some(Self::Detail(short("detail")?)),
            _ => None,
        }
    }

    /// The message with the answer.
    pub(crate) fn answered(&self, answer: &Result<ViewAnswer, String>) -> Message {
        let error = answer.as_ref().err();
        let found = match answer {
            Ok(ViewAnswer::Found(found)) => found.as_slice(),
            _ => &[],
        };
        let found: Vec<Value> = found.iter().map(|(id, score)| json!({ "id": id, "score": score })).collect();
        let message = match self {
            Self::Find(text) => json!({ "kind": "found", "text": text, "objects": found, "error": error }),
            Self::Name(id, label) => json!({ "kind": "named", "id": id, "label": label, "error": error }),
            Self::Merge(ids) => {
                json!({ "kind": "merged", "ids": ids, "into": ids.iter().min(), "error": error })
            }
            Self::Detail(detail) => json!({ "kind": "detail", "detail": detail, "error": error }),
        };
        Message::text(message.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_and_anything_else_is_not() {
        let found = |text: &str| ViewRequest::parse(text);
        assert_eq!(found(r#"{"ask":"find","text":" red mug "}"#), Some(ViewRequest::Find("red mug".to_owned())));
        let named = |label: Option<&str>| Some(ViewRequest::Name(7, label.map(str::to_owned)));
        assert_eq!(found(r#"{"ask":"name","id":7,"label":"mug"}"#), named(Some("mug")));
        assert_eq!(found(r#"{"ask":"name","id":7,"label":" "}"#), named(None));
        let long = format!(r#"{{"ask":"find","text":"{}"}}"#, "x".repeat(MAX_TEXT + 1));
        let wrong =
            ["", "shown", "{}", r#"{"ask":"stop"}"#, r#"{"ask":"find"}"#, r#"{"ask":"name","id":0,"label":"a"}"#];
        assert_eq!(found(r#"{"ask":"merge","ids":[9,7]}"#), Some(ViewRequest::Merge(vec![9, 7])));
        assert_eq!(found(r#"{"ask":"detail","detail":"fine"}"#), Some(ViewRequest::Detail("fine".to_owned())));
        let not_merged =
            [r#"{"ask":"merge","ids":[9]}"#, r#"{"ask":"merge","ids":[9,0]}"#, r#"{"ask":"merge","ids":[9,"7"]}"#];
        let more = [long.as_str(), r#"{"ask":"name","id":-1,"label":"a"}"#, r#"{"ask":"detail","detail":1}"#];
        for text in wrong.into_iter().chain(more).chain(not_merged) {
            assert_eq!(found(text), None, "{text}");
        }
    }
}
