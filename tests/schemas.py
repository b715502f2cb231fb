"""The schemas of the docs, and what is wrong with a value by one."""

import json
from pathlib import Path

import numpy as np

DOCS = Path(__file__).parents[1] / "docs"
SCHEMAS = {path.name.removesuffix(".schema.json"): json.loads(path.read_text()) for path in DOCS.glob("schemas/*.json")}
TYPES = {
    "string": str,
    "number": (int, float),
    "integer": int,
    "boolean": bool,
    "array": list,
    "object": dict,
    "null": type(None),
}


def problems(value, schema, where="$"):
    """What is wrong with a value by the part of JSON Schema that the schemas of the docs use."""
    known = {"$schema", "title", "description", "type", "enum", "const", "properties", "required", "items"}
    known |= {"additionalProperties", "minItems", "maxItems", "minimum", "maximum", "anyOf", "minLength"}
    assert schema.keys() <= known, schema.keys() - known
    if "anyOf" in schema:
        found = [problems(value, one, where) for one in schema["anyOf"]]
        return [] if any(not one for one in found) else min(found, key=len)
    if "const" in schema and value != schema["const"]:
        return [f"{where}: {value!r} is not {schema['const']!r}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{where}: {value!r} is none of {schema['enum']}"]
    kinds = [schema["type"]] if isinstance(schema.get("type"), str) else schema.get("type", list(TYPES))
    if not any(isinstance(value, TYPES[k]) and (k == "boolean" or not isinstance(value, bool)) for k in kinds):
        return [f"{where}: {value!r} is no {kinds}"]
    if isinstance(value, dict):
        return _problems_of_object(value, schema, where)
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", np.inf):
            return [f"{where} has {len(value)} items"]
        parts = enumerate(value) if "items" in schema else ()
        return [one for index, part in parts for one in problems(part, schema["items"], f"{where}[{index}]")]
    if isinstance(value, int | float) and not schema.get("minimum", -np.inf) <= value <= schema.get("maximum", np.inf):
        return [f"{where}: {value} is out of bounds"]
    return []


def _problems_of_object(value, schema, where):
    found = [f"{where} has no {key!r}" for key in schema.get("required", ()) if key not in value]
    more = schema.get("additionalProperties", True)
    for key, part in value.items():
        if key in schema.get("properties", {}):
            found += problems(part, schema["properties"][key], f"{where}.{key}")
        elif more is False:
            found.append(f"{where}: {key!r} is not in the schema")
        elif isinstance(more, dict):
            found += problems(part, more, f"{where}.{key}")
    return found
