/** Words of the workflow pages and of the editor. */

export const words = {
  list: {
    title: "Workflows",
    create: "New workflow",
    templates: "Templates",
    mine: "Workflows",
    empty: "No workflow yet. Begin with a template, or with an empty one.",
    copy: "Copy",
    useTemplate: "Use template",
    name: "Name",
  },
  editor: {
    check: "Check",
    run: "Run…",
    save: "Save version",
    find: "Find a step",
    chemistry: "Chemistry steps",
    deviceActions: "Device actions",
    emptyCanvas: "Pick a step on the left to begin.",
    nothingSelected: "Select a step to see what it does.",
    readOnlyPhone: "Read-only on a phone. Open on a larger screen to edit.",
    readOnly: "Read-only: you may not edit this workflow.",
    checking: "Checking…",
    clean: "No findings",
    conflict: "Somebody else saved this draft in between.",
    loadTheirs: "Load theirs",
    keepMine: "Save mine over it",
    unsaved: "not saved",
    saving: "saving…",
  },
  rings: {
    fields: "Fields",
    graph: "Graph",
    materials: "Materials",
    resources: "Resources",
  },
} as const;
