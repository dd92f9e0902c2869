// Makes src/schema.ts, the types of the API's objects, of ../openapi.json, the station's description of its API.

import { readFile, writeFile } from 'node:fs/promises';
import { fileURLToPath } from 'node:url';

const here = fileURLToPath(new URL('.', import.meta.url));
const { schemas } = JSON.parse(await readFile(`${here}../openapi.json`, 'utf8')).components;

const comment = (text, indent) =>
  (text ?? '').split('\n').map((line) => (line === '' ? '' : `${indent}/// ${line}\n`)).join('');

/// The type of a schema. What this does not know is an error, so that no type is looser than its schema.
function type(schema, indent = '') {
  if (schema.$ref !== undefined) return schema.$ref.replace('#/components/schemas/', '');
  if (schema.oneOf !== undefined) return schema.oneOf.map((one) => type(one, indent)).join(' | ');
  if (schema.allOf !== undefined) return schema.allOf.map((one) => type(one, indent)).join(' & ');
  if (schema.enum !== undefined) return schema.enum.map((value) => JSON.stringify(value)).join(' | ');
  const types = [schema.type].flat().map((name) => {
    switch (name) {
      case 'integer':
      case 'number':
        return 'number';
      case 'string':
      case 'boolean':
      case 'null':
        return name;
      case 'array':
        return list(schema, indent);
      case 'object':
        return object(schema, indent);
      default:
        throw new Error(`no type for ${JSON.stringify(schema)}`);
    }
  });
  return types.join(' | ');
}

function list({ items, minItems, maxItems }, indent) {
  const item = type(items, indent);
  return minItems !== undefined && minItems === maxItems
    ? `[${Array(minItems).fill(item).join(', ')}]`
    : `${/[|&]/.test(item) ? `(${item})` : item}[]`;
}

function object({ properties = {}, required = [], additionalProperties }, indent) {
  if (additionalProperties !== undefined && additionalProperties !== false) {
    return `Record<string, ${type(additionalProperties, indent)}>`;
  }
  const inner = `${indent}  `;
  const members = Object.entries(properties).map(([key, schema]) => {
    const mark = required.includes(key) ? '' : '?';
    return `${comment(schema.description, inner)}${inner}${key}${mark}: ${type(schema, inner)};\n`;
  });
  return `{\n${members.join('')}${indent}}`;
}

const types = Object.entries(schemas).map(([name, schema]) => {
  const head = comment(schema.description, '');
  if (schema.enum === undefined) return `${head}export type ${name} = ${type(schema)};\n`;
  // The values too: the page lists them.
  return `${head}export const ${name}s = ${JSON.stringify(schema.enum)} as const;\nexport type ${name} = (typeof ${name}s)[number];\n`;
});
await writeFile(`${here}src/schema.ts`, `// Made by types.mjs of ../openapi.json.\n\n${types.join('\n')}`);
