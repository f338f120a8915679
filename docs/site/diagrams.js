// Flow charts are drawn in their own size, so that their words can be read; a wide one scrolls.
const initialize = mermaid.initialize;
mermaid.initialize = (options) => initialize({ ...options, flowchart: { useMaxWidth: false } });
