//! Random values of any type that can be deserialised: numbers of all lengths, and every variant of every enumeration.
//! So a new message is in the tests without a strategy of its own.

use std::collections::BTreeSet;

use baliza_wire::telemetry::Message;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use serde::de::value::{Error, U32Deserializer};
use serde::de::{
    DeserializeOwned, DeserializeSeed, Deserializer, EnumAccess, IntoDeserializer, SeqAccess, VariantAccess, Visitor,
};

/// A random value.
pub fn value<T: DeserializeOwned>(rng: &mut Pcg64) -> T {
    match T::deserialize(Drawn { rng }) {
        Ok(value) => value,
        Err(error) => panic!("the type needs what is not drawn here: {error}"),
    }
}

/// Answers each request of a type with a random value.
struct Drawn<'r> {
    rng: &'r mut Pcg64,
}

impl Drawn<'_> {
    /// A number of 0 to 64 bits: each length is equally likely.
    fn bits(&mut self) -> u64 {
        let length = self.rng.random_range(0..=u64::BITS);
        self.rng.random::<u64>().checked_shr(u64::BITS - length).unwrap_or(0)
    }
}

/// The methods for numbers: the lowest bits, so that a signed number is negative as often as not.
macro_rules! numbers {
    ($($method:ident $visit:ident $number:ty,)+) => {
        $(fn $method<V: Visitor<'de>>(mut self, visitor: V) -> Result<V::Value, Error> {
            let number = if self.rng.random() { self.bits() } else { !self.bits() };
            visitor.$visit(number as $number)
        })+
    };
}

impl<'de> Deserializer<'de> for Drawn<'_> {
    type Error = Error;

    fn is_human_readable(&self) -> bool {
        false
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, Error> {
        Err(serde::de::Error::custom("a value whose type is not known"))
    }

    numbers! {
        deserialize_u8 visit_u8 u8,
        deserialize_u16 visit_u16 u16,
        deserialize_u32 visit_u32 u32,
        deserialize_u64 visit_u64 u64,
        deserialize_i8 visit_i8 i8,
        deserialize_i16 visit_i16 i16,
        deserialize_i32 visit_i32 i32,
        deserialize_i64 visit_i64 i64,
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_bool(self.rng.random())
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        if self.rng.random() { visitor.visit_some(self) } else { visitor.visit_none() }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(self, _: &'static str, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_seq(Fields { rng: self.rng, left: length })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.deserialize_tuple(fields.len(), visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        let index = self.rng.random_range(0..variants.len()) as u32;
        visitor.visit_enum(Variant { rng: self.rng, index })
    }

    serde::forward_to_deserialize_any! {
        i128 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq tuple_struct map identifier ignored_any
    }
}

/// The fields of a structure, or the elements of an array.
struct Fields<'r> {
    rng: &'r mut Pcg64,
    left: usize,
}

impl<'de> SeqAccess<'de> for Fields<'_> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, Error> {
        let Some(left) = self.left.checked_sub(1) else { return Ok(None) };
        self.left = left;
        seed.deserialize(Drawn { rng: self.rng }).map(Some)
    }
}

/// A variant of an enumeration, with its content.
struct Variant<'r> {
    rng: &'r mut Pcg64,
    index: u32,
}

impl<'de> EnumAccess<'de> for Variant<'_> {
    type Error = Error;
    type Variant = Self;

    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), Error> {
        let index: U32Deserializer<Error> = self.index.into_deserializer();
        Ok((seed.deserialize(index)?, self))
    }
}

impl<'de> VariantAccess<'de> for Variant<'_> {
    type Error = Error;

    fn unit_variant(self) -> Result<(), Error> {
        Ok(())
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Error> {
        seed.deserialize(Drawn { rng: self.rng })
    }

    fn tuple_variant<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Error> {
        Drawn { rng: self.rng }.deserialize_tuple(length, visitor)
    }

    fn struct_variant<V: Visitor<'de>>(self, fields: &'static [&'static str], visitor: V) -> Result<V::Value, Error> {
        self.tuple_variant(fields.len(), visitor)
    }
}

#[test]
fn every_kind_of_message_is_drawn() {
    let mut rng = Pcg64::seed_from_u64(1);
    let drawn: BTreeSet<_> = (0..1000).map(|_| value::<Message>(&mut rng).kind()).collect();
    assert_eq!(drawn, BTreeSet::from_iter(Message::KINDS.iter().copied()));
}
