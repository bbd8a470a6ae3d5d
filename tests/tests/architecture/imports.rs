//! The modules of a crate, and the modules that each of them imports from, read from its sources.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use syn::punctuated::Punctuated;
use syn::visit::{self, Visit};
use syn::{Attribute, Expr, ExprLit, Item, ItemMod, ItemUse, Lit, Meta, Token, UseTree};

/// A module, by its path in the crate.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Module(Vec<String>);

/// The modules of a crate.
pub(crate) struct Crate {
    files: BTreeMap<Module, Contents>,
}

/// The contents of a module.
#[derive(Default)]
struct Contents {
    /// Paths in its code, as they are written.
    paths: Vec<Vec<String>>,
    /// The names that it imports, and their paths: `use` brings a name in for those who import from here, too.
    names: BTreeMap<String, Vec<String>>,
}

impl Module {
    /// Returns the top-level module: the first part of the path, empty at the root.
    pub(crate) fn top(&self) -> &str {
        self.0.first().map_or("", String::as_str)
    }

    /// Returns true for the module itself and for those inside of it.
    pub(crate) fn is_within(&self, other: &Self) -> bool {
        self.0.starts_with(&other.0)
    }

    fn child(&self, name: &str) -> Self {
        let mut path = self.0.clone();
        path.push(name.to_owned());
        Self(path)
    }
}

impl fmt::Display for Module {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join("::"))
    }
}

impl Crate {
    /// Reads the sources of a crate in a folder of the repository.
    pub(crate) fn read(sources: &str) -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(sources);
        let mut read = Self { files: BTreeMap::new() };
        read.read_file(&folder.join("lib.rs"), &folder, Module::default());
        assert!(read.files.len() > 5, "{sources}: a crate has modules");
        read
    }

    /// Returns each import: the module that has it, and the one in which its target stands.
    pub(crate) fn imports(&self) -> Vec<(Module, Module)> {
        let mut imports = Vec::new();
        for (module, contents) in &self.files {
            for path in contents.paths.iter().chain(contents.names.values()) {
                let target = self.resolve(module, path, 0);
                imports.extend(target.filter(|target| target != module).map(|target| (module.clone(), target)));
            }
        }
        imports
    }

    /// Returns the module in which the target of a path stands; `None` for a path to another crate.
    fn resolve(&self, from: &Module, path: &[String], depth: usize) -> Option<Module> {
        let mut parts = path.iter();
        let mut module = match parts.next()?.as_str() {
            "crate" => Module::default(),
            "self" => from.clone(),
            "super" => Module(from.0.split_last()?.1.to_vec()),
            name if self.files.contains_key(&from.child(name)) => from.child(name),
            _ => return None,
        };
        for part in parts {
            if part == "super" {
                module.0.pop();
            } else if self.files.contains_key(&module.child(part)) {
                module = module.child(part);
            } else if let Some(elsewhere) = self.files.get(&module)?.names.get(part).filter(|_| depth < 8) {
                // A name of another crate that is handed on belongs to who hands it on.
                return self.resolve(&module, elsewhere, depth + 1).or(Some(module));
            } else {
                break;
            }
        }
        Some(module)
    }

    /// Reads a file and the modules in it, whose files are in `folder`.
    fn read_file(&mut self, file: &Path, folder: &Path, module: Module) {
        let text = fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        let syntax = syn::parse_file(&text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        self.read_items(syntax.items, folder, module);
    }

    fn read_items(&mut self, items: Vec<Item>, folder: &Path, module: Module) {
        let mut reader = Reader::default();
        for item in &items {
            match item {
                Item::Mod(inner) => {
                    if !is_for_tests(&inner.attrs) {
                        self.read_module(inner, folder, &module);
                    }
                }
                item => reader.visit_item(item),
            }
        }
        // A module may have a file for each system.
        let contents = self.files.entry(module).or_default();
        contents.paths.extend(reader.contents.paths);
        contents.names.extend(reader.contents.names);
    }

    fn read_module(&mut self, inner: &ItemMod, folder: &Path, outer: &Module) {
        let name = inner.ident.to_string();
        let (module, inside) = (outer.child(&name), folder.join(&name));
        match &inner.content {
            Some((_, items)) => self.read_items(items.clone(), &inside, module),
            None => {
                let mut files: Vec<PathBuf> = paths(&inner.attrs).iter().map(|path| folder.join(path)).collect();
                if files.is_empty() {
                    let candidates = [folder.join(format!("{name}.rs")), inside.join("mod.rs")];
                    files.extend(candidates.into_iter().find(|file| file.exists()));
                }
                assert!(!files.is_empty(), "no file for {module}");
                for file in files {
                    self.read_file(&file, &inside, module.clone());
                }
            }
        }
    }
}

/// Gathers the paths of code.
#[derive(Default)]
struct Reader {
    contents: Contents,
}

impl Reader {
    /// Adds the names that a `use` brings in.
    fn add_use(&mut self, tree: &UseTree, mut path: Vec<String>) {
        match tree {
            UseTree::Path(step) => {
                path.push(step.ident.to_string());
                self.add_use(&step.tree, path);
            }
            UseTree::Group(group) => group.items.iter().for_each(|tree| self.add_use(tree, path.clone())),
            UseTree::Name(name) if name.ident == "self" => {
                if let Some(last) = path.last().cloned() {
                    self.contents.names.insert(last, path);
                }
            }
            UseTree::Name(name) => {
                path.push(name.ident.to_string());
                self.contents.names.insert(name.ident.to_string(), path);
            }
            UseTree::Rename(rename) => {
                path.push(rename.ident.to_string());
                self.contents.names.insert(rename.rename.to_string(), path);
            }
            UseTree::Glob(_) => self.contents.paths.push(path),
        }
    }
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_item(&mut self, item: &'ast Item) {
        let attributes = match item {
            Item::Const(item) => &item.attrs,
            Item::Fn(item) => &item.attrs,
            Item::Impl(item) => &item.attrs,
            Item::Use(item) => &item.attrs,
            _ => &Vec::new(),
        };
        if !is_for_tests(attributes) {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'ast ItemUse) {
        self.add_use(&item.tree, Vec::new());
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        self.contents.paths.push(path.segments.iter().map(|segment| segment.ident.to_string()).collect());
        visit::visit_path(self, path);
    }
}

fn is_for_tests(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("cfg")
            && attribute.parse_args::<Meta>().is_ok_and(|meta| meta.path().is_ident("test"))
    })
}

/// Returns the files of `#[path = "…"]`, also where a `cfg_attr` has it.
fn paths(attributes: &[Attribute]) -> Vec<String> {
    let path_of = |meta: Meta| match meta {
        Meta::NameValue(pair) if pair.path.is_ident("path") => match pair.value {
            Expr::Lit(ExprLit { lit: Lit::Str(path), .. }) => Some(path.value()),
            _ => None,
        },
        _ => None,
    };
    let metas = attributes.iter().flat_map(|attribute| match &attribute.meta {
        Meta::List(list) if list.path.is_ident("cfg_attr") => {
            let inner = list.parse_args_with(Punctuated::<Meta, Token![,]>::parse_terminated);
            inner.into_iter().flatten().collect()
        }
        meta => vec![meta.clone()],
    });
    metas.filter_map(path_of).collect()
}
