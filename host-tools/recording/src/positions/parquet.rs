//! Positions as Apache Parquet: one row group, optional columns of UTF-8, INT64 and DOUBLE, no compression. Epochs whose
//! names are all whole numbers are numbers. The file's metadata have the unit of each column, the version and the
//! command.

use std::sync::Arc;

use anyhow::Result;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::columns::{Column, Entry, Values, finite, round};

/// The column that may be of numbers.
const EPOCH: &str = "epoch";

type Group<'a> = SerializedRowGroupWriter<'a, Vec<u8>>;

/// The file. The entries are gone through once for each column.
///
/// # Errors
/// The Parquet writer returns an error.
pub fn encode<'a>(
    columns: &[&Column],
    entries: &(impl Iterator<Item = Entry<'a>> + Clone),
    [version, command]: [&str; 2],
) -> Result<Vec<u8>> {
    let are_numbers = entries.clone().all(|entry| number_of(entry.epoch.name).is_some());
    let is_number = |column: &Column| are_numbers && column.name == EPOCH;
    let fields = columns.iter().map(|column| field(column, is_number(column))).collect::<Result<_>>()?;
    let schema = Type::group_type_builder("positions").with_fields(fields).build()?;
    let units = columns.iter().filter_map(|column| Some(format!("{}: {}", column.name, unit(column.name)?)));
    let units = units.collect::<Vec<_>>().join(", ");
    let metadata = [("baliza.version", version), ("baliza.command", command), ("baliza.units", &units)];
    let metadata = metadata.map(|(key, value)| KeyValue::new(key.to_owned(), value.to_owned()));
    let properties = WriterProperties::builder().set_created_by("baliza".to_owned());
    let properties = properties.set_key_value_metadata(Some(metadata.to_vec())).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for column in columns {
        let entries = entries.clone();
        match column.values {
            Values::Text(_) if is_number(column) => {
                write::<Int64Type>(&mut group, entries.map(|entry| number_of(entry.epoch.name)))?;
            }
            Values::Text(of) => {
                let values = entries.map(|entry| of(&entry).map(ByteArray::from));
                write::<ByteArrayType>(&mut group, values)?;
            }
            Values::Count(of) => {
                let values = entries.map(|entry| of(&entry).and_then(|count| i64::try_from(count).ok()));
                write::<Int64Type>(&mut group, values)?;
            }
            Values::Exact(of) => {
                write::<DoubleType>(&mut group, entries.map(|entry| finite(of(&entry))))?;
            }
            Values::Rounded(decimals, of) => {
                let values = entries.map(|entry| finite(of(&entry)).map(|number| round(number, decimals)));
                write::<DoubleType>(&mut group, values)?;
            }
        }
    }
    group.close()?;
    Ok(writer.into_inner()?)
}

/// The number that an epoch's name is, where the number gives the name again.
fn number_of(name: &str) -> Option<i64> {
    name.parse().ok().filter(|number: &i64| number.to_string() == name)
}

/// The unit at the end of a column's name.
fn unit(column: &str) -> Option<&'static str> {
    [("_m_s", "m/s"), ("_m2", "m²"), ("_m", "m"), ("_s", "s")]
        .into_iter()
        .find_map(|(end, unit)| column.ends_with(end).then_some(unit))
}

fn field(column: &Column, is_number: bool) -> Result<TypePtr> {
    let (physical, logical) = match column.values {
        Values::Text(_) if is_number => (Physical::INT64, None),
        Values::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
        Values::Count(_) => (Physical::INT64, None),
        Values::Exact(_) | Values::Rounded(..) => (Physical::DOUBLE, None),
    };
    let field = Type::primitive_type_builder(column.name, physical);
    Ok(Arc::new(field.with_repetition(Repetition::OPTIONAL).with_logical_type(logical).build()?))
}

/// Writes the next column. A definition level is 1 where the value is known, and only known values are stored.
fn write<T: DataType>(group: &mut Group, values: impl Iterator<Item = Option<T::T>>) -> Result<()> {
    let values: Vec<Option<T::T>> = values.collect();
    let levels: Vec<i16> = values.iter().map(|value| value.is_some().into()).collect();
    let known: Vec<T::T> = values.into_iter().flatten().collect();
    if let Some(mut column) = group.next_column()? {
        column.typed::<T>().write_batch(&known, Some(&levels), None)?;
        column.close()?;
    }
    Ok(())
}
