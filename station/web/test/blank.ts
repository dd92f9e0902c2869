// Objects of the API, of which a test names what it needs: the station's description says which other keys there are.

import description from '../../openapi.json' with { type: 'json' };

interface Schema {
  $ref?: string;
  allOf?: Schema[];
  oneOf?: Schema[];
  enum?: string[];
  type?: string | string[];
  properties?: Record<string, Schema>;
}

const schemas = description.components.schemas as unknown as Record<string, Schema>;

/// An object of a schema in which nothing is known but these values: the others are null, or else 0, false or empty.
export function blank<T>(name: string, known: Partial<T>): T {
  return { ...(value(schemas[name]) as T), ...known };
}

function value(schema: Schema): unknown {
  if (schema.$ref !== undefined) return value(schemas[schema.$ref.replace('#/components/schemas/', '')]);
  if (schema.allOf !== undefined) return Object.assign({}, ...schema.allOf.map(value));
  if (schema.oneOf?.some((one) => one.type === 'null')) return null;
  if (schema.enum !== undefined) return schema.enum[0];
  const types = [schema.type].flat();
  if (types.includes('null')) return null;
  switch (types[0]) {
    case 'object':
      return Object.fromEntries(Object.entries(schema.properties ?? {}).map(([key, of]) => [key, value(of)]));
    case 'array':
      return [];
    case 'boolean':
      return false;
    case 'string':
      return '';
    default:
      return 0;
  }
}
