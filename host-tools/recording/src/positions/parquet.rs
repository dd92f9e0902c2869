//! Positions as Apache Parquet: one row group, optional columns of UTF-8, INT64 and DOUBLE, no compression.

use std::sync::Arc;

use anyhow::Result;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::columns::{Column, Entry, Values, finite, round};

type Group<'a> = SerializedRowGroupWriter<'a, Vec<u8>>;

/// The file. The entries are gone through once for each column.
///
/// # Errors
/// The Parquet writer returns an error.
pub fn encode<'a>(columns: &[&Column], entries: &(impl Iterator<Item = Entry<'a>> + Clone)) -> Result<Vec<u8>> {
    let fields = columns.iter().map(|column| field(column)).collect::<Result<_>>()?;
    let schema = Type::group_type_builder("positions").with_fields(fields).build()?;
    let properties = WriterProperties::builder().set_created_by("baliza".to_owned()).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for column in columns {
        let entries = entries.clone();
        match column.values {
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

fn field(column: &Column) -> Result<TypePtr> {
    let (physical, logical) = match column.values {
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
