//! The claims of a person to a name and a role.

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use openidconnect::AdditionalClaims;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::OidcError;
use crate::model::UserRole;

/// The longest name, characters.
const NAME: usize = 100;
/// The claims that may be a person's name, the best first.
const NAMES: [&str; 3] = ["preferred_username", "email", "name"];

/// Which values of the claim give which role.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Roles {
    /// May see everything.
    pub view: Vec<String>,
    /// May draw zones and survey as well.
    pub operate: Vec<String>,
    /// May change sites as well.
    pub administer: Vec<String>,
}

/// A person who has signed in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct User {
    /// What the provider calls the person, for ever.
    pub subject: String,
    /// What people call the person.
    pub name: String,
    /// What they may do.
    pub role: UserRole,
}

/// What the provider tells of a person.
#[derive(Debug, Default)]
pub(super) struct Given(Map<String, Value>);

/// Claims beyond those that the standard names.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Claims(Map<String, Value>);

impl AdditionalClaims for Claims {}

impl Given {
    /// The claims of a signed token (RFC 7519). Its signature was checked before.
    pub fn of_token(token: &str) -> Option<Self> {
        let claims = URL_SAFE_NO_PAD.decode(token.split('.').nth(1)?).ok()?;
        serde_json::from_slice(&claims).ok().map(Self)
    }

    pub fn of_value(value: Value) -> Self {
        match value {
            Value::Object(claims) => Self(claims),
            _ => Self::default(),
        }
    }

    /// These, and others where there are none of these.
    pub fn and(self, others: Self) -> Self {
        let mut all = others.0;
        all.extend(self.0);
        Self(all)
    }

    /// A claim by its name, or by a path with points.
    fn get(&self, claim: &str) -> Option<&Value> {
        self.0.get(claim).or_else(|| {
            let mut names = claim.split('.');
            let first = self.0.get(names.next()?)?;
            names.try_fold(first, |value, name| value.get(name))
        })
    }
}

/// Claims to roles.
#[derive(Clone, Debug)]
pub(super) struct Mapping {
    claim: String,
    roles: Vec<(String, UserRole)>,
}

impl Mapping {
    /// # Errors
    /// There is no value, or one has two roles.
    pub fn of(claim: &str, roles: &Roles) -> Result<Self, OidcError> {
        let Roles { view, operate, administer } = roles;
        let mut known: Vec<(String, UserRole)> = Vec::new();
        for (values, role) in [(view, UserRole::View), (operate, UserRole::Operate), (administer, UserRole::Administer)]
        {
            for value in values {
                if known.iter().any(|(known, _)| known == value) {
                    return Err(OidcError::Twice(value.clone()));
                }
                known.push((value.clone(), role));
            }
        }
        if known.is_empty() { Err(OidcError::NoRoles) } else { Ok(Self { claim: claim.to_owned(), roles: known }) }
    }

    /// Whether the claim is there.
    pub fn is_in(&self, given: &Given) -> bool {
        given.get(&self.claim).is_some()
    }

    /// The person, with the highest role that a value gives; None: there is none.
    pub fn user(&self, subject: &str, given: &Given) -> Option<User> {
        let values = values(given.get(&self.claim)?);
        let role =
            self.roles.iter().filter(|(value, _)| values.contains(&value.as_str())).map(|(_, role)| *role).max()?;
        let name = NAMES.iter().find_map(|name| given.get(name)?.as_str().filter(|name| !name.is_empty()));
        let name = name.unwrap_or(subject).chars().filter(|letter| !letter.is_control()).take(NAME).collect();
        Some(User { subject: subject.to_owned(), name, role })
    }

    /// Why there is no role, for the log.
    pub fn why(&self, given: &Given) -> String {
        match given.get(&self.claim).map(values) {
            None => format!("there is no claim {:?}", self.claim),
            Some(values) => {
                // Only as much as a line of the log can hold.
                let some: Vec<_> =
                    values.iter().take(10).map(|value| value.chars().take(NAME).collect::<String>()).collect();
                format!("{:?} has {some:?}", self.claim)
            }
        }
    }
}

/// A text, a list of texts, or an object whose keys are the values.
fn values(claim: &Value) -> Vec<&str> {
    match claim {
        Value::String(one) => vec![one],
        Value::Array(all) => all.iter().filter_map(Value::as_str).collect(),
        Value::Object(all) => all.keys().map(String::as_str).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn mapping(claim: &str) -> Mapping {
        let texts = |text: &str| text.split_whitespace().map(str::to_owned).collect();
        let roles = Roles { view: texts("staff guests"), operate: texts("leads"), administer: texts("admins") };
        Mapping::of(claim, &roles).unwrap()
    }

    fn role(claim: &str, claims: Value) -> Option<UserRole> {
        mapping(claim).user("248289761001", &Given::of_value(claims)).map(|user| user.role)
    }

    #[test]
    fn the_highest_role_of_a_persons_groups_counts_and_unknown_groups_give_none() {
        assert_eq!(role("groups", json!({"groups": ["staff", "leads", "x"]})), Some(UserRole::Operate));
        assert_eq!(role("groups", json!({"groups": ["admins", "staff"]})), Some(UserRole::Administer));
        assert_eq!(role("groups", json!({"groups": "guests"})), Some(UserRole::View));
        for claims in [json!({}), json!({"groups": []}), json!({"groups": ["admin"]}), json!({"groups": "staff leads"})]
        {
            assert_eq!(role("groups", claims.clone()), None, "{claims}");
        }
        assert_eq!(role("groups", json!({"groups": [1, null, ["admins"], {"admins": 1}]})), None);
        assert_eq!(role("groups", json!({"groups": true})), None);
    }

    #[test]
    fn a_claim_is_found_by_its_name_with_points_or_by_its_path() {
        let keycloak = json!({"realm_access": {"roles": ["leads", "offline_access"]}});
        assert_eq!(role("realm_access.roles", keycloak), Some(UserRole::Operate));
        let zitadel = json!({"urn:zitadel:iam:org:project:roles": {"admins": {"1": "example.org"}}});
        assert_eq!(role("urn:zitadel:iam:org:project:roles", zitadel), Some(UserRole::Administer));
        assert_eq!(
            role("https://example.org/groups", json!({"https://example.org/groups": ["staff"]})),
            Some(UserRole::View)
        );
        assert_eq!(role("a.b.c", json!({"a": {"b": "staff"}})), None);
    }

    #[test]
    fn a_name_is_short_and_has_no_line_breaks() {
        let user = |claims| mapping("groups").user("248289761001", &Given::of_value(claims)).unwrap();
        assert_eq!(user(json!({"groups": "staff"})).name, "248289761001");
        assert_eq!(user(json!({"groups": "staff", "email": "ana@example.org", "name": "Ana"})).name, "ana@example.org");
        let hostile = user(json!({"groups": "staff", "preferred_username": format!("a\n{}", "é".repeat(1000))}));
        assert_eq!(hostile.name, format!("a{}", "é".repeat(99)));
    }

    #[test]
    fn roles_without_values_or_with_one_value_twice_are_refused() {
        assert!(matches!(Mapping::of("groups", &Roles::default()), Err(OidcError::NoRoles)));
        let roles = Roles { view: vec!["all".into()], administer: vec!["all".into()], ..Roles::default() };
        assert!(matches!(Mapping::of("groups", &roles), Err(OidcError::Twice(value)) if value == "all"));
    }

    #[test]
    fn the_token_counts_before_what_is_asked_for() {
        let [token, asked] = [json!({"a": 1}), json!({"a": 2, "b": 3})].map(Given::of_value);
        assert_eq!(Value::Object(token.and(asked).0), json!({"a": 1, "b": 3}));
    }
}
